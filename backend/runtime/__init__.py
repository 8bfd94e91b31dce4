"""What every command of the program shares: how it runs, prints and fails, its threads and its output."""
