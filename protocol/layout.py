"""protocol/schema.toml as Python objects: what every emitter and the golden frames are made from."""

from __future__ import annotations

import json
import re
import tomllib
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SCALARS = {"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4, "u64": 8, "i64": 8}
REPLY_BIT = 0x80
NOT_ON_THE_LINE = ("doc", "platform", "states", "locks_itself", "refusals", "since")
"""Keys that do not change what the bytes mean."""
LONGEST_REFUSAL = 90
CRC_SIZE = 4


class SchemaError(Exception):
    """The schema contradicts itself; the message names the place."""


@dataclass(frozen=True)
class Field:
    """One field: ``count`` 0 is a scalar, ``base`` a scalar's name, a record's name or "bytes"."""

    name: str
    base: str
    count: int
    doc: str
    enum: str
    platform: bool
    since: int = 0
    """The revision that added it; 0: the version began with it."""

    @property
    def is_tail(self) -> bool:
        return self.base == "bytes"

    @property
    def is_blob(self) -> bool:
        """u8[N]: bytes of a fixed length rather than numbers."""
        return self.base == "u8" and self.count > 8

    @property
    def type_text(self) -> str:
        return f"{self.base}[{self.count}]" if self.count else self.base


@dataclass(frozen=True)
class Message:
    """A request, a reply or a stream message; ``kind`` says which."""

    name: str
    kind: str
    number: int
    doc: str
    fields: tuple[Field, ...]
    states: tuple[str, ...] = ()
    """Of a request: the supervisor's states it is allowed in; empty: all."""
    locks_itself: bool = False
    """Of a request: it is slow, and the device's tick runs on meanwhile."""
    refusals: tuple[tuple[str, str], ...] = ()
    """Of a request: status and what it means for this one, where more can be said than for all."""
    since: int = 0
    """The revision that added it, as of a field."""

    @property
    def full_name(self) -> str:
        return self.name if self.kind == "stream" else f"{self.name}_{self.kind}"

    @property
    def tail(self) -> Field | None:
        return self.fields[-1] if self.fields and self.fields[-1].is_tail else None

    @property
    def fixed(self) -> tuple[Field, ...]:
        return tuple(f for f in self.fields if not f.is_tail)


@dataclass(frozen=True)
class Enum:
    name: str
    doc: str
    values: dict[str, int]
    since: dict[str, int]


@dataclass(frozen=True)
class Record:
    name: str
    doc: str
    fields: tuple[Field, ...]


@dataclass(frozen=True)
class Schema:
    name: str
    version: int
    max_payload: int
    header: tuple[Field, ...]
    reply_head: tuple[Field, ...]
    tick: tuple[Field, ...]
    enums: dict[str, Enum]
    records: dict[str, Record]
    messages: tuple[Message, ...]
    fingerprint: int

    @property
    def revision(self) -> int:
        """The newest of all that was added."""
        fields = [f.since for m in self.messages for f in m.fields] + [f.since for f in self.tick]
        values = [since for enum in self.enums.values() for since in enum.since.values()]
        return max([0, *fields, *values, *(m.since for m in self.messages)])

    def least(self, fields: tuple[Field, ...]) -> int:
        """``size`` without what was added."""
        return self.size(tuple(f for f in fields if f.since == 0))

    def size(self, fields: tuple[Field, ...]) -> int:
        """Bytes of the fixed fields among these."""
        return sum(self._size(f) * max(f.count, 1) for f in fields if not f.is_tail)

    def _size(self, field: Field) -> int:
        return SCALARS[field.base] if field.base in SCALARS else self.size(self.records[field.base].fields)

    def pack(self, fields: tuple[Field, ...], values: dict[str, Any]) -> bytes:
        """Fields as bytes, spelled out; the golden frames check the two generated codecs against this one."""
        out = b""
        for field in fields:
            value = values[field.name]
            if field.is_tail or field.is_blob:
                out += bytes.fromhex(value)
                continue
            for item in value if field.count else [value]:
                if field.base in SCALARS:
                    out += item.to_bytes(SCALARS[field.base], "little", signed=field.base[0] == "i")
                else:
                    out += self.pack(self.records[field.base].fields, item)
        return out


def load(path: Path) -> Schema:
    """Reads and checks the schema.

    Raises:
        SchemaError: a duplicate, an unknown type, a tail that is not last, a payload over the limit.
    """
    raw = tomllib.loads(path.read_text())
    enums = {n: Enum(n, e["doc"], e["values"], e.get("since", {})) for n, e in raw["enums"].items()}
    records = {n: Record(n, r["doc"], _fields(r["fields"])) for n, r in raw["records"].items()}
    reply_head = _fields(raw["reply"]["fields"])
    messages = []
    for c in raw["commands"]:
        how = tuple(c.get("states", ())), c.get("locks_itself", False), tuple(c.get("refusals", {}).items())
        since = c.get("since", 0)
        messages.append(Message(c["name"], "request", c["number"], c["doc"], _fields(c["request"]), *how, since))
        reply = reply_head + _fields(c["reply"])
        messages.append(Message(c["name"], "reply", c["number"] + REPLY_BIT, c["doc"], reply, since=since))
    for s in raw["streams"]:
        since = s.get("since", 0)
        messages.append(Message(s["name"], "stream", s["number"], s["doc"], _fields(s["fields"]), since=since))
    schema = Schema(
        raw["name"],
        raw["version"],
        raw["max_payload"],
        _fields(raw["header"]["fields"]),
        reply_head,
        _fields(raw["tick"]["fields"]),
        enums,
        records,
        tuple(messages),
        _fingerprint(raw),
    )
    _check(schema)
    return schema


def _fields(raw: list[dict[str, Any]]) -> tuple[Field, ...]:
    out = []
    for f in raw:
        match = re.fullmatch(r"(\w+?)(?:\[(\d+)\])?", f["type"])
        if match is None:
            raise SchemaError(f"field {f['name']}: cannot read type {f['type']!r}")
        words = f.get("doc", ""), f.get("enum", ""), f.get("platform", False), f.get("since", 0)
        out.append(Field(f["name"], match[1], int(match[2] or 0), *words))
    return tuple(out)


def _fingerprint(raw: dict[str, Any]) -> int:
    """CRC-32 of all that gives the bytes on the line their meaning: names, numbers, types, order; of what the version
    began with, so that its revisions share it."""

    def is_added(node: Any) -> bool:
        return isinstance(node, dict) and isinstance(node.get("since"), int)

    def layout(node: Any) -> Any:
        if isinstance(node, dict):
            return {k: layout(v) for k, v in node.items() if k not in NOT_ON_THE_LINE}
        return [layout(v) for v in node if not is_added(v)] if isinstance(node, list) else node

    enums = {
        name: enum | {"values": {k: v for k, v in enum["values"].items() if k not in enum.get("since", {})}}
        for name, enum in raw["enums"].items()
    }
    enums = {name: enum for name, enum in enums.items() if enum["values"]}
    records = {name: record for name, record in raw["records"].items() if not is_added(record)}
    raw = raw | {"enums": enums, "records": records}

    return zlib.crc32(json.dumps(layout(raw), sort_keys=True).encode())


def _check(schema: Schema) -> None:
    groups = {f"record {r.name}": r.fields for r in schema.records.values()}
    groups |= {f"message {m.full_name}": m.fields for m in schema.messages}
    for where, fields in groups.items():
        names = [f.name for f in fields]
        if len(set(names)) != len(names):
            raise SchemaError(f"{where}: a field's name occurs twice")
        for f in fields:
            if f.base not in SCALARS and f.base not in schema.records and not f.is_tail:
                raise SchemaError(f"{where}: field {f.name} has unknown type {f.base}")
            if f.is_tail and (f is not fields[-1] or where.startswith("record")):
                raise SchemaError(f"{where}: bytes field {f.name} must be the last of a message")
            if f.since and (where.startswith("record") or fields[-1].is_tail):
                raise SchemaError(
                    f"{where}: {f.name} cannot be added: only to messages, and not to one that ends in bytes"
                )
            if f.enum and f.enum not in schema.enums:
                raise SchemaError(f"{where}: field {f.name} names unknown enum {f.enum}")
        if [f.since for f in fields] != sorted(f.since for f in fields):
            raise SchemaError(f"{where}: fields that were added stand at the end, in the order of their revisions")
        if where.startswith("message") and schema.size(fields) > schema.max_payload:
            raise SchemaError(f"{where}: {schema.size(fields)} bytes exceed max_payload {schema.max_payload}")
    for m in schema.messages:
        _check_handling(schema, m)
    for what in ("number", "full_name"):
        seen = [getattr(m, what) for m in schema.messages]
        if len(set(seen)) != len(seen):
            raise SchemaError(f"two messages share a {what}")
    if {f.name: 1 << i for i, f in enumerate(schema.tick)} != schema.enums["channel"].values:
        raise SchemaError("enum channel must have one bit per field of [tick], in its order")


def _check_handling(schema: Schema, message: Message) -> None:
    """What is said about a command beside its bytes."""
    for state in message.states:
        if state not in schema.enums["state"].values:
            raise SchemaError(f"command {message.name}: unknown state {state}")
    for status, words in message.refusals:
        if status not in schema.enums["status"].values:
            raise SchemaError(f"command {message.name}: unknown status {status}")
        if len(words) > LONGEST_REFUSAL:
            raise SchemaError(f"command {message.name}: refusal {status} is longer than {LONGEST_REFUSAL} characters")
