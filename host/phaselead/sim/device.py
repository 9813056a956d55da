"""The firmware and the plant kernel as a shared library, and a device made of both, in virtual time."""

from __future__ import annotations

import ctypes
from functools import cache
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from phaselead.compiled import library_path
from phaselead.device import BAUD
from phaselead.errors import BadInput, PhaseleadError
from phaselead.sim.plant import PlantParameters
from phaselead.sim.structures import LinkedParameters

Codes = NDArray[np.uint16]

NOT_RESTORED = {
    1: "the recording's control state is not one of this firmware; replay it with the version that made it",
    2: "the recording lacks the waveform of an axis that runs one; record again",
    3: "the recording lacks the model that its feed-forward hangs on; record again",
}
"""By enum host_restored of host.h."""

_POINTER = ctypes.c_void_p
_SIZE = ctypes.c_size_t
_U64 = ctypes.c_uint64
_U32 = ctypes.c_uint32
_BYTES = ctypes.c_char_p
_SIGNATURES = {
    "host_open": (_POINTER, (_U32, _BYTES, _SIZE)),
    "host_close": (None, (_POINTER,)),
    "host_write": (_SIZE, (_POINTER, _BYTES, _SIZE)),
    "host_read": (_SIZE, (_POINTER, _POINTER, _SIZE)),
    "host_readable": (_SIZE, (_POINTER,)),
    "host_tick": (_U64, (_POINTER,)),
    "host_run": (_U64, (_POINTER, _POINTER, _U64, _SIZE)),
    "host_run_codes": (None, (_POINTER, _POINTER, _POINTER, _U64)),
    "host_restore": (ctypes.c_int, (_POINTER, _U64, _BYTES, _SIZE)),
    "host_driven_axes": (_U32, (_POINTER,)),
    "host_state_size": (_SIZE, ()),
    "host_flash": (_POINTER, (_POINTER, ctypes.POINTER(_SIZE), ctypes.POINTER(_U64))),
    "host_cells": (_POINTER, (_POINTER, ctypes.POINTER(_SIZE))),
    "host_inject": (None, (_POINTER, _U32, _U32)),
    "host_reset": (None, (_POINTER,)),
    "host_kept_memory": (_POINTER, (_POINTER, ctypes.POINTER(_SIZE))),
    "host_trigger_at": (ctypes.c_int, (_POINTER, _U64)),
    "host_take_obeyed": (_U64, (_POINTER, _POINTER, _SIZE)),
    "host_cut_power_after": (None, (_POINTER, _U64)),
    "host_state_name": (_BYTES, (_U32,)),
    "host_event_name": (_BYTES, (_U32,)),
    "host_action_name": (_BYTES, (_U32,)),
    "host_fault_reaction": (_BYTES, (_U32,)),
    "host_transition": (_U32, (_U32, _U32)),
    "host_device_size": (_SIZE, ()),
    "host_run_sections": (None, (_POINTER, _SIZE, _POINTER, _SIZE)),
    "plant_open": (_POINTER, (ctypes.POINTER(PlantParameters),)),
    "plant_close": (None, (_POINTER,)),
    "plant_parameters_size": (_SIZE, ()),
    "plant_linked_parameters_size": (_SIZE, ()),
    "plant_run": (None, (_POINTER, _POINTER, _POINTER, _U64)),
    "plant_push": (ctypes.c_int, (_POINTER, _U32, ctypes.c_double, _U64)),
    "plant_trace": (ctypes.c_int, (_POINTER, _SIZE)),
    "plant_take_trace": (_SIZE, (_POINTER, _POINTER, _SIZE, ctypes.POINTER(_U64))),
}


@cache
def load_library(path: str | None = None) -> ctypes.CDLL:
    """The compiled firmware; ``path`` for another build of it. Raises PhaseleadError when it is not built."""
    if path is None:
        built = library_path("phaselead.sim._firmware")
        if built is None:
            raise PhaseleadError("the firmware library is not built; run `pip install .` (or `make`) with a C compiler")
        path = str(built)
    library = ctypes.CDLL(path)
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    sizes = library.plant_parameters_size(), library.plant_linked_parameters_size()
    if sizes != (ctypes.sizeof(PlantParameters), ctypes.sizeof(LinkedParameters)):
        raise PhaseleadError("the firmware library is of another version than the package; build it again")
    return library


OBEYED_KEPT = 4096
"""HOST_OBEYED of host.h."""


class _Obeyed(ctypes.Structure):
    _fields_ = (("session", _U64), ("id", _U32), ("type", _U32))


class Obeyed(NamedTuple):
    """A command that the device carried out: neither refused before nor answered from the replies it keeps."""

    session: int
    id: int
    number: int
    """Of the command in the wire."""


class Firmware:
    """One device without a stage: bytes in, bytes out, and ticks driven by converter codes."""

    def __init__(self, baud: int = BAUD, flash: bytes | None = None, library: ctypes.CDLL | None = None) -> None:
        self.library = library or load_library()
        self._handle = self.library.host_open(baud, flash, len(flash or b""))
        if not self._handle:
            raise BadInput("the flash image has the wrong size; give one that a simulated device wrote, or none")

    def close(self) -> None:
        if self._handle:
            self.library.host_close(self._handle)
            self._handle = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __del__(self) -> None:
        if getattr(self, "_handle", None):
            self.close()

    @property
    def tick(self) -> int:
        """The next tick to run."""
        return int(self.library.host_tick(self._handle))

    @property
    def readable(self) -> int:
        return int(self.library.host_readable(self._handle))

    def write(self, data: bytes) -> int:
        return int(self.library.host_write(self._handle, data, len(data)))

    def read(self, size: int) -> bytes:
        """What has left the device, at most ``size`` bytes."""
        buffer = ctypes.create_string_buffer(min(size, self.readable))
        count = self.library.host_read(self._handle, buffer, len(buffer))
        return buffer.raw[:count]

    def run_codes(self, adc_codes: Codes) -> Codes:
        """Runs the ticks of ``adc_codes``, shape (n, 3); gives their DAC codes, shape (n, 3)."""
        adc = np.ascontiguousarray(adc_codes, np.uint16)
        dac = np.empty_like(adc)
        self.library.host_run_codes(self._handle, adc.ctypes.data, dac.ctypes.data, len(adc))
        return dac

    def restore(self, session: int, state: bytes) -> None:
        """Continues from a control state. Raises BadInput when it is none, or hangs on what is missing."""
        reason = self.library.host_restore(self._handle, session, state, len(state))
        if reason != 0:
            raise BadInput(NOT_RESTORED[reason])

    @property
    def driven_axes(self) -> int:
        """Mask of the axes whose output follows a path."""
        return int(self.library.host_driven_axes(self._handle))

    def inject(self, fault: int, axis: int = 0) -> None:
        """Makes a fault happen (enum fault of the wire)."""
        self.library.host_inject(self._handle, fault, axis)

    def reset(self, kept: bytes | None = None) -> None:
        """Its reset pin is pulled. ``kept``: what has become of the memory that a reset leaves as it is."""
        if kept is not None:
            size = _SIZE()
            address = self.library.host_kept_memory(self._handle, ctypes.byref(size))
            ctypes.memmove(address, kept, min(len(kept), size.value))
        self.library.host_reset(self._handle)

    def kept_memory(self) -> bytes:
        """What a reset leaves as it is, and a loss of power does not: the faults that wait to be written to flash."""
        size = _SIZE()
        address = self.library.host_kept_memory(self._handle, ctypes.byref(size))
        return ctypes.string_at(address, size.value)

    def trigger_at(self, tick: int) -> None:
        """An edge comes at the trigger input before this tick. Raises BadInput when it has passed, or beyond the 64
        that are kept."""
        if not self.library.host_trigger_at(self._handle, tick):
            raise BadInput(
                f"an edge at tick {tick} has passed already, or is one of more than 64; give later ones, fewer"
            )

    def take_obeyed(self) -> list[Obeyed]:
        """The commands carried out since the last call, in their order. Raises PhaseleadError when they were too many
        to be kept: look more often."""
        kept = (_Obeyed * OBEYED_KEPT)()
        count = self.library.host_take_obeyed(self._handle, kept, OBEYED_KEPT)
        if count > OBEYED_KEPT:
            raise PhaseleadError(f"{count} commands were carried out, only the last {OBEYED_KEPT} are known")
        return [Obeyed(one.session, one.id, one.type) for one in kept[:count]]

    def cut_power_after(self, flash_bytes: int) -> None:
        """Flash stops changing after so many more bytes."""
        self.library.host_cut_power_after(self._handle, flash_bytes)

    def flash(self) -> tuple[bytes, int]:
        """The flash image, and how often it has been written to."""
        size, writes = _SIZE(), _U64()
        address = self.library.host_flash(self._handle, ctypes.byref(size), ctypes.byref(writes))
        return ctypes.string_at(address, size.value), writes.value

    def cells(self) -> bytes:
        """All of its flash, for another device: models, images, boot record, and which bits are in doubt."""
        size = _SIZE()
        address = self.library.host_cells(self._handle, ctypes.byref(size))
        return ctypes.string_at(address, size.value)


class Plant:
    """A stage in C, at rest."""

    def __init__(self, parameters: PlantParameters, library: ctypes.CDLL | None = None) -> None:
        self.library = library or load_library()
        self.handle = self.library.plant_open(ctypes.byref(parameters))
        if not self.handle:
            raise BadInput("the stage cannot be simulated: a time constant, frequency or delay is out of bounds")
        self._capacity = 0

    def close(self) -> None:
        if self.handle:
            self.library.plant_close(self.handle)
            self.handle = None

    def __del__(self) -> None:
        if getattr(self, "handle", None):
            self.close()

    def run(self, dac_codes: Codes) -> Codes:
        """ADC codes, shape (n, 3), against DAC codes, shape (n, 3)."""
        dac = np.ascontiguousarray(dac_codes, np.uint16)
        adc = np.empty_like(dac)
        self.library.plant_run(self.handle, dac.ctypes.data, adc.ctypes.data, len(dac))
        return adc

    def push(self, axis: int, um: float, tick: int) -> None:
        """A further force on the stage itself from ``tick`` on, as um of static displacement. Raises BadInput for one
        that has passed, or beyond the 64 that the kernel holds."""
        if self.library.plant_push(self.handle, axis, um, tick) != 0:
            raise BadInput(
                f"a force at tick {tick} has passed already, or is one of more than 64; give later ones, fewer"
            )

    def trace(self, capacity: int) -> None:
        """Keeps true positions from now on, the last ``capacity`` ticks of them; 0 stops."""
        if self.library.plant_trace(self.handle, capacity) != 0:
            raise BadInput(f"no memory for {capacity} true positions; keep fewer")
        self._capacity = capacity

    def take_trace(self) -> tuple[int, NDArray[np.float64]]:
        """First tick, and true positions in um, shape (n, 3), since the last call."""
        positions = np.empty((self._capacity, 3))
        first = _U64()
        count = self.library.plant_take_trace(self.handle, positions.ctypes.data, self._capacity, ctypes.byref(first))
        return first.value, positions[:count].copy()


class VirtualDevice(Firmware):
    """The firmware with a stage behind its converters."""

    def __init__(
        self,
        parameters: PlantParameters,
        *,
        baud: int = BAUD,
        flash: bytes | None = None,
        library: ctypes.CDLL | None = None,
    ) -> None:
        super().__init__(baud, flash, library)
        self.plant = Plant(parameters, self.library)

    def run(self, ticks: int, want_bytes: int = 0) -> int:
        """Runs up to ``ticks`` ticks, or until ``want_bytes`` (not 0) are readable. Gives the ticks run."""
        return int(self.library.host_run(self._handle, self.plant.handle, ticks, want_bytes))

    def close(self) -> None:
        super().close()
        if hasattr(self, "plant"):
            self.plant.close()
