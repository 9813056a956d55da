"""A stage as an instrument of PyMeasure: ``from phaselead.drivers.pymeasure import PhaseleadStage``."""

from __future__ import annotations

from pymeasure.adapters import Adapter
from pymeasure.instruments import Channel, Instrument

from phaselead.control import Controller, GainsLike, connect
from phaselead.device import AxisWhere
from phaselead.model import StageLike


class StageAxis(Channel):
    """One axis: ``stage.x.target_um = 40``."""

    parent: PhaseleadStage

    def _where(self) -> AxisWhere:
        return self.parent.controller.where().axes[str(self.id)]

    @property
    def position_um(self) -> float:
        """Get the measured position (float, um)."""
        return self._where().x_um

    @property
    def voltage_V(self) -> float:
        """Get the output (float, V)."""
        return self._where().u_V

    @property
    def on_target(self) -> bool:
        """Get whether the axis has settled on its target (bool)."""
        return self._where().on_target

    @property
    def target_um(self) -> float:
        """Control the target (float, um). Setting it arms the device, moves, and returns when the axis has settled or a
        second after the move; it raises BadInput, before anything moves, for a place out of range."""
        return self._where().target_um

    @target_um.setter
    def target_um(self, um: float) -> None:
        self.parent.move(**{str(self.id): um})

    @property
    def range_um(self) -> tuple[float, float]:
        """Get the lowest and the highest target (two floats, um)."""
        return self.parent.controller.range_um(str(self.id))


class PhaseleadStage(Instrument):
    """A stage on ``port`` (a serial port, or "sim://xyz250"). Nothing moves before a target is set.

    ``model`` is a stage file; with ``mode`` and ``gains`` as for ``Controller.move`` it says how the axes are held.
    ``controller`` has all the rest: tracking, recording, waves. ``shutdown`` parks; so does the end of ``with``.
    """

    x: StageAxis = Instrument.ChannelCreator(StageAxis, "x")
    y: StageAxis = Instrument.ChannelCreator(StageAxis, "y")
    z: StageAxis = Instrument.ChannelCreator(StageAxis, "z")

    def __init__(
        self,
        port: str | None = None,
        name: str = "phaselead stage",
        *,
        model: StageLike | None = None,
        mode: str | None = None,
        gains: GainsLike | None = None,
    ) -> None:
        self.controller = connect(port)
        self._model, self._mode, self._gains = model, mode, gains
        super().__init__(_Opened(self.controller), name, includeSCPI=False)

    def move(self, x: float | None = None, y: float | None = None, z: float | None = None) -> None:
        """Moves axes together to places in um: ``stage.move(x=40, y=20)``; as setting ``target_um``."""
        self.controller.move(x=x, y=y, z=z, model=self._model, mode=self._mode, gains=self._gains)

    def hold(self) -> None:
        """Stops what moves and holds it there."""
        self.controller.hold()

    def shutdown(self) -> None:
        """Parks the device and closes its port."""
        self.controller.close()
        super().shutdown()


class _Opened(Adapter):
    """An adapter around a controller, which PyMeasure closes with it. It sends no text."""

    def __init__(self, controller: Controller) -> None:
        super().__init__()
        self.connection = controller
