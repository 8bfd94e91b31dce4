"""The system below every command: processes, signals, arguments, and files read and written within bounds."""
