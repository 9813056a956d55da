"""Errors a user can cause or meet. Each carries one line that says what is wrong and what to do next."""


class PhaseleadError(Exception):
    """Base of every error that a user can cause or meet. ``exit_status`` is what the command line ends with.

    >>> import phaselead as pl
    >>> try:
    ...     pl.fit([])
    ... except pl.PhaseleadError as error:
    ...     print(error, error.exit_status)
    no recordings to fit; give at least one file 2
    """

    exit_status = 1


class BadInput(PhaseleadError):
    """A file, an option or a waveform that cannot be used as given. Nothing was written or moved.

    >>> import phaselead as pl
    >>> pl.load("nowhere.toml")
    Traceback (most recent call last):
    phaselead.errors.BadInput: nowhere.toml: cannot be read (No such file or directory); give a stage file (.toml)
    """

    exit_status = 2


class LinkError(PhaseleadError):
    """A port that is missing, busy, silent or speaks something else.

    >>> import phaselead as pl
    >>> pl.connect("/dev/nowhere")
    Traceback (most recent call last):
    phaselead.errors.LinkError: port /dev/nowhere does not exist; `phaselead ports` lists those that do
    """

    exit_status = 3


class DeviceRefused(PhaseleadError):
    """The device understood and said no, or latched a fault.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     armed = dev.arm()
    ...     run = dev.track("sine:60um@5Hz", mode="pid")
    Traceback (most recent call last):
    phaselead.device.session.Refused: arm refused (wrong_state): not in this state; ...
    """

    exit_status = 4


def more_like_it(others: int) -> str:
    """What a line about one thing says of so many others of which the same is true.

    >>> more_like_it(2), more_like_it(0)
    (' (2 more like it)', '')
    """
    return f" ({others} more like it)" if others else ""
