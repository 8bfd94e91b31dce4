"""The one error a user can mend: its message names the rule, what was got, and the remedy."""


class LiveHandError(Exception):
    """Bad input. Libraries raise it, commands print it and end with code 1, operators report it."""
