"""The one exception that a user is meant to read."""


class InputError(ValueError):
    """Bad input from outside (file, recording, option): one sentence that says what is wrong and what to do.

    The command line prints it on one line and exits with status 2; a node logs it and stays unconfigured.
    """
