"""The one owner of the device: a thread that reads the stream, carries out orders one by one, and stops at once."""

from __future__ import annotations

import contextlib
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from datetime import datetime
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from phaselead.control import HOST_TIMEOUT_S, Controller, connect
from phaselead.device import TICK_HZ, Limits, Where, explain_fault
from phaselead.errors import LinkError, PhaseleadError
from phaselead.model import Stage
from phaselead.scope.samples import Samples
from phaselead.scope.settings import settings_of
from phaselead.scope.trigger import Trigger

READ_S = 0.012
"""Of one read of the stream: the page is drawn every 17 ms."""
LOOK_S = 0.1
"""How often the device is asked where it is, which also feeds its host timeout of 1 s."""
SILENT_S = 1.0
"""Without a sample the stream is begun again: a capture or a fault has ended it."""
FIND_S = 0.5
"""Two tries at a port that has gone away."""
LINES_KEPT = 50

Order = Callable[["Hub", Mapping[str, Any]], str]


class StoppedError(PhaseleadError):
    """What was under way was ended by STOP, or because nobody looks on any more."""


class Hub:
    """Owns the controller of one port. ``samples``, ``trigger`` and ``state()`` are for any thread to read.

    Nothing but its own thread gives the device orders. When no tab has been open for ``park_after_s`` seconds it ends
    what is under way and parks; 0: never.
    """

    def __init__(
        self,
        port: str,
        *,
        axes: str = "xyz",
        stage: Stage | None = None,
        folder: Path = Path(),
        park_after_s: float = 10.0,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        """Opens the port; raises as ``connect``. ``say`` is told what should not be overlooked."""
        self.port, self.folder, self.park_after_s, self.say = port, folder, park_after_s, say
        self.samples, self.trigger = Samples(axes), Trigger()
        # What `phaselead move` left held is taken over where it stands.
        self.dev: Controller = connect(port, resume=True)
        self.stage = self.dev.model if stage is None else stage
        self.files: list[str] = []
        """Names in ``folder`` that were written by orders."""
        self.lines: deque[tuple[str, str, str]] = deque(maxlen=LINES_KEPT)
        """Time, kind (said, warning, refused), words."""
        self.job: dict[str, Any] | None = None
        """Name and share of what takes long, None when nothing does."""
        self.where: Where | None = None
        self.away = ""
        """Why the device cannot be reached; empty when it can."""
        self.fault = ""
        self._live = self.dev.live(axes)
        self._orders: SimpleQueue[tuple[Order, Mapping[str, Any], Future[str]]] = SimpleQueue()
        self._stop, self._ending = threading.Event(), threading.Event()
        self._busy = self._ended_early = False
        self._alone_since: float | None = None if self.dev.resumed else time.monotonic()
        """None while a tab is open, and while what was held before is seen by none yet."""
        self._looked_s = self._came_s = 0.0
        self.hard: Limits | None = None
        """The hard limits of the device, as they were last read."""
        self._settings_of: tuple[Stage | None, Limits | None, dict[str, Any]] = (None, None, {})
        self._at_rest = False
        """It was seen parked, and no order has moved it since: what it followed is history."""
        self._thread = threading.Thread(target=self._run, name="phaselead scope", daemon=True)

    def start(self) -> None:
        """Begins to read; nothing moves."""
        self._thread.start()

    def close(self) -> str:
        """Ends what is under way, parks the device and closes the port; what has become of it, in words."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()
        try:
            parked = self.dev.park().state == "parked"
        except (PhaseleadError, OSError):
            parked = False
        with contextlib.suppress(PhaseleadError, OSError):
            self.dev.close()
        if parked:
            return "the scope has ended; the device is parked"
        return "the scope has ended; whether the device is parked is not known: look with `phaselead status`"

    # ---------------------------------------------------------------- for any thread

    def give(self, order: Order, arguments: Mapping[str, Any]) -> Future[str]:
        """Carries an order out when those before it are done; the words it ends with, or what it raises."""
        done: Future[str] = Future()
        self._orders.put((order, arguments, done))
        return done

    def stop(self) -> None:
        """Ramps every axis to its safe value, before anything that waits; what is under way ends."""
        self._stop.set()

    def somebody_looks(self, tabs: int) -> None:
        """How many tabs are open."""
        self._alone_since = None if tabs else time.monotonic()

    def tell(self, words: str, kind: str = "said") -> None:
        """A line for every tab."""
        self.lines.append((f"{datetime.now():%H:%M:%S}", kind, " ".join(words.split())))

    def state(self) -> dict[str, Any]:
        """All that a tab shows beside the traces."""
        where = self.where
        return {
            "port": self.port,
            "away": self.away,
            "state": "away" if self.away or where is None else where.state,
            "fault": self.fault,
            "axes": {} if where is None else where.as_dict()["axes"],
            "model": None if self.stage is None else {"name": self.stage.name, "axes": sorted(self.stage.axes)},
            "limits": self._limits(),
            "settings": self._settings(),
            "dropped": self.samples.dropped,
            "job": self.job,
            "lines": list(self.lines),
            "files": self.files,
            "trigger": {"run": self.trigger.run, "waiting": self.trigger.waiting},
        }

    def _limits(self) -> dict[str, Any]:
        axes = {} if self.stage is None else self.stage.axes
        return {axis: {"x_um": [m.sensor.x_min_um, m.sensor.x_max_um]} for axis, m in axes.items()}

    def _settings(self) -> dict[str, Any]:
        stage, hard, known = self._settings_of
        if stage is not self.stage or hard is not self.hard:
            known = settings_of(self.stage, self.hard)
            self._settings_of = self.stage, self.hard, known
        return known

    # ---------------------------------------------------------------- for orders, in the hub's thread

    def progress(self, share: float) -> None:
        """Of the job under way. Raises StoppedError when it is to end."""
        if self.job is not None:
            self.job = self.job | {"share": round(share, 4)}
        self._between()

    def about_to_move(self) -> None:
        """Axes that stood parked follow something from here on, until they are seen parked again."""
        self._at_rest = False

    def new_file(self, name: str) -> Path:
        """Where an order may write; the page links to it."""
        if name not in self.files:
            self.files = [*self.files, name]
        return self.folder / name

    @contextlib.contextmanager
    def working(self, name: str, *, streams: bool = True) -> Iterator[None]:
        """While it lasts, a job of this name is under way. Samples of its captures come through; one that leaves the
        device alone does not stream."""
        self.job = {"name": name, "share": 0.0}
        self.about_to_move()
        if not streams:
            self._live.pause()
        try:
            yield
        finally:
            self.job = None
            self.restream()

    def restream(self) -> None:
        """Begins the stream, or begins it again after what has ended it or changed the model. A line that cannot carry
        it is told of; one that is gone is found so by the next read."""
        self._came_s = time.monotonic()
        try:
            self._live.start()
        except LinkError:
            pass
        except PhaseleadError as error:
            if not self.lines or self.lines[-1][2] != " ".join(str(error).split()):
                self.tell(str(error), "refused")

    # ---------------------------------------------------------------- the thread

    def _run(self) -> None:
        self._live.before_each = self._between
        self._take_over()
        self.restream()
        while not self._ending.is_set():
            try:
                self._turn()
            except KeyboardInterrupt:  # of the main thread, which closes this one
                continue
            except LinkError as error:
                self._lost(error)
            except PhaseleadError as error:
                self.tell(str(error), "refused")
        with contextlib.suppress(PhaseleadError, OSError):
            self._live.before_each = None
            self._live.close()

    def _take_over(self) -> None:
        """Hard limits are read, once. What was held when the port was opened is held on, and parks from now on when
        this program is killed."""
        with contextlib.suppress(PhaseleadError):  # of a device that has gone meanwhile, which the next read tells
            self.hard = self.dev.limits()
        if self.dev.resumed:
            self.dev.device.set_timeout(round(HOST_TIMEOUT_S * TICK_HZ))
            held = (f"{axis} at {one.target_um:.3f} um" for axis, one in self.dev.where().axes.items() if one.held)
            self.tell(f"taken over as it was held: {', '.join(held)}")

    def _turn(self) -> None:
        if self.away:
            self._find_again()
            return
        if self._stop.is_set():
            self._stop.clear()
            self.dev.stop()
            self.tell("STOP: every axis ramps to its safe value")
        self._next_order()
        now_s = time.monotonic()
        if now_s - self._looked_s >= LOOK_S:
            self._looked_s = now_s
            self._look()
        self._take(self._live.read(READ_S))
        if now_s - self._came_s > SILENT_S:
            self.restream()

    def _take(self, parts: list[Any]) -> None:
        for part in parts:
            self.samples.add(part.without_reference() if self._at_rest else part)
        if parts:
            self._came_s = time.monotonic()
            self.trigger.look(self.samples)

    def _between(self) -> None:
        """After every read of the port, in captures too."""
        if threading.current_thread() is not self._thread or not self._busy:
            return
        self._take(self._live.take())
        if (self._stop.is_set() or self._ending.is_set() or self._left_alone()) and not self._ended_early:
            self._ended_early = True
            raise StoppedError("stopped" if self._stop.is_set() else "ended: no page is open")

    def _next_order(self) -> None:
        try:
            order, arguments, done = self._orders.get_nowait()
        except Empty:
            return
        if not done.set_running_or_notify_cancel():  # the tab has gone before it was carried out
            return
        self._busy, self._ended_early = True, False
        try:
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                words = order(self, arguments)
            for one in said:
                self.tell(str(one.message), "warning")
            if words:
                self.tell(words)
            done.set_result(words)
        except PhaseleadError as error:
            self.tell(str(error), "refused")
            done.set_exception(error)
            if isinstance(error, LinkError):
                raise
        except Exception as error:  # an order must not end the thread that can stop the stage
            self.tell(f"{type(error).__name__}: {error}", "refused")
            done.set_exception(PhaseleadError(f"{type(error).__name__}: {error}"))
        finally:
            self._busy, self._looked_s = False, 0.0

    def _look(self) -> None:
        self.where = where = self.dev.where()
        self._at_rest = where.state == "parked"
        if where.fault == "none":
            self.fault = ""
        elif not self.fault:
            self.fault = self.dev.status().sentence()
            self.tell(self.fault, "refused")
            with contextlib.suppress(PhaseleadError):
                self.tell(explain_fault(where.fault).text.partition(" Occurs on ")[0])
        if self._left_alone() and where.state in ("armed", "running"):
            self.dev.park()
            line = f"parked: no page was open for {self.park_after_s:g} s"
            self.tell(line)
            self.say(line)

    def _left_alone(self) -> bool:
        since = self._alone_since
        return since is not None and 0 < self.park_after_s <= time.monotonic() - since

    def _lost(self, error: LinkError) -> None:
        self.away = " ".join(str(error).split())
        self.tell(f"{self.away}; a device that hears nothing for a second parks by itself", "refused")

    def _find_again(self) -> None:
        self._stop.clear()
        with contextlib.suppress(Empty):
            _, _, done = self._orders.get_nowait()
            if done.set_running_or_notify_cancel():
                done.set_exception(LinkError(self.away))
        try:
            known = self.dev.reconnect(within_s=FIND_S)
        except LinkError:
            self._ending.wait(0.1)
            return
        self.away = ""
        self.tell("the device is there again" + ("" if known else "; it has restarted, and its paths are gone"))
        self.restream()
