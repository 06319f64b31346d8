"""Typed errors that a user can act on.

Every message names the file or the field, what was expected and what was found.
"""


class MattgsError(Exception):
    """Base of all errors that the project raises on purpose."""


class InputError(MattgsError):
    """The user's input cannot be used; raised before any long work starts."""


class StageError(MattgsError):
    """A stage ran and failed; the experiment becomes a row with this reason."""
