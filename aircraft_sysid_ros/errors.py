"""The exceptions that a user is meant to read."""

from __future__ import annotations

from typing import Any


class InputError(ValueError):
    """Bad input from outside (file, recording, option): one sentence that says what is wrong and what to do.

    The command line prints it on one line and exits with status 2; a node logs it and stays unconfigured.
    """


class IncompleteError(Exception):
    """Something is missing in what was done: one sentence that says what and how much, with ``result``, what there is.

    The command line prints both, and exits with status 1.
    """

    def __init__(self, sentence: str, result: dict[str, Any]) -> None:
        super().__init__(sentence)
        self.result = result
