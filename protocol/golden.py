"""Golden frames: for every message a few instances, as values and as the bytes on the line."""

from __future__ import annotations

import json
from typing import Any

from layout import SCALARS, Field, Schema
from phaselead.device import encode_frame

SESSION = 0x0123456789ABCDEF
TAILS = {"zero": b"", "ramp": bytes(range(256)), "low": b"\0" * 5, "high": b"\xff" * 300}


def golden(schema: Schema) -> str:
    frames = []
    for number, message in enumerate(schema.messages):
        for kind in TAILS if message.fields else ["zero"]:
            fields = {f.name: _value(schema, f, kind, i) for i, f in enumerate(message.fields)}
            request = 0 if message.kind == "stream" else (number * 257 + len(kind)) & 0xFFFF
            header = {"type": message.number, "id": request, "session": SESSION}
            body = schema.pack(schema.header, header) + schema.pack(message.fields, fields)
            frame = encode_frame(body).hex()
            frames.append({"message": message.full_name, **header, "fields": fields, "frame": frame})
    origin = "from protocol/schema.toml by protocol/generate.py"
    head = {"generated": origin, "fingerprint": schema.fingerprint}
    lines = ",\n".join(json.dumps(f) for f in frames)
    return json.dumps(head)[:-1] + ', "frames": [\n' + lines + "\n]}\n"


def _value(schema: Schema, field: Field, kind: str, index: int) -> Any:
    """One field's value in JSON: numbers, lists, dicts; bytes as hex."""
    if field.is_tail:
        return TAILS[kind].hex()
    if field.is_blob:
        return bytes(_number("u8", kind, index + i) for i in range(field.count)).hex()

    def item(i: int) -> Any:
        if field.base in SCALARS:
            return _number(field.base, kind, index + i)
        inner = enumerate(schema.records[field.base].fields)
        return {f.name: _value(schema, f, kind, index + i + k) for k, f in inner}

    return [item(i) for i in range(field.count)] if field.count else item(0)


def _number(base: str, kind: str, index: int) -> int:
    bits, signed = 8 * SCALARS[base], base[0] == "i"
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    if kind == "ramp":  # every byte another one, so that an exchanged or shifted byte shows
        value = int.from_bytes(bytes((index * 16 + k + 1) & 0xFF for k in range(bits // 8)), "little")
        return value - (1 << bits) if signed and value > high else value
    return {"zero": 0, "low": low, "high": high}[kind]
