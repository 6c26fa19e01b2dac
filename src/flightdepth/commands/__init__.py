"""What each command of the command line does, a module each. Heavy imports stand inside the functions."""
