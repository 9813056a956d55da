"""Every command of GCS that is spoken here. They run in the hub's thread."""

from __future__ import annotations

from phaselead.gcs.commands import data_recorder, identity, motion, parameters, wave_generator
from phaselead.gcs.commands.known import COMMANDS, Known, Stage

__all__ = ["COMMANDS", "Known", "Stage", "data_recorder", "identity", "motion", "parameters", "wave_generator"]
