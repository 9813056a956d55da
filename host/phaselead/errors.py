"""Errors a user can cause or meet. Each carries one line that says what is wrong and what to do next."""


class PhaseleadError(Exception):
    """Base of every error the command line turns into one line and an exit status."""

    exit_status = 1


class BadInput(PhaseleadError):
    """A file, an option or a waveform that cannot be used as given."""

    exit_status = 2


class LinkError(PhaseleadError):
    """A port that is missing, busy, silent or speaks something else."""

    exit_status = 3


class DeviceRefused(PhaseleadError):
    """The device understood and said no, or latched a fault."""

    exit_status = 4
