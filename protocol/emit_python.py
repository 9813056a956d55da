"""Emits host/phaselead/device/wire.py."""

from __future__ import annotations

import textwrap

from layout import REPLY_BIT, SCALARS, Enum, Field, Message, Schema

CODES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "u64": "Q", "i64": "q"}

PREAMBLE = '''\
# generated from protocol/schema.toml by protocol/generate.py
"""Every message, record and enumeration of the wire; docs/wire.md says them in words.

Fields hold plain numbers even where an enumeration exists, so that a value unknown to this version survives.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Generic, Self, TypeVar

from phaselead.errors import LinkError

FINGERPRINT = 0x{fingerprint:08X}
VERSION = {version}
REVISION = {revision}
"""Of the version: what was added to it, which one that speaks an earlier revision does not know."""
MAX_PAYLOAD = {max_payload}
REPLY_BIT = 0x{reply_bit:02X}
HEADER = struct.Struct("{header}")
"""{header_names}"""
REPLY_HEAD = struct.Struct("{reply_head}")
"""{reply_names}"""
CHANNEL_DTYPES = {dtypes}
"""Of one axis in one tick of a samples batch, in the order of Channel's bits."""


class WireError(LinkError):
    """A payload that is not the message it claims to be, or a value its field cannot hold."""


class Message:
    """What all messages and records share. ``SIZE`` is the fixed part's; ``TAIL``: bytes follow it."""

    __slots__ = ()
    NAME: ClassVar[str]
    NUMBER: ClassVar[int]
    SIZE: ClassVar[int]
    LEAST: ClassVar[int | None] = None
    """SIZE without the fields that revisions added, where there are such."""
    TAIL: ClassVar[bool] = False
    PLATFORM: ClassVar[frozenset[str]] = frozenset()
    """Fields that may differ between builds of the same source."""

    def pack(self) -> bytes:
        """Payload bytes. Raises WireError for a value its field cannot hold."""
        raise NotImplementedError

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """The message of these payload bytes. Raises WireError when their number is wrong."""
        raise NotImplementedError

    @classmethod
    def fitted(cls, payload: bytes) -> bytes:
        """As long as this revision knows it: what is missing is zero, what is beyond is left out. Raises WireError."""
        size, least = len(payload), cls.SIZE if cls.LEAST is None else cls.LEAST
        if size < least or (cls.TAIL and size > MAX_PAYLOAD):
            at_least = "at least " if size < least else ""
            raise WireError(f"{{cls.NAME}}: {{at_least}}{{least}} bytes expected, got {{size}}")
        return payload if cls.TAIL else payload[: cls.SIZE].ljust(cls.SIZE, bytes(1))


class Record(Message):
    """A part of a message: always of its full size."""

    __slots__ = ()

    @classmethod
    def fitted(cls, payload: bytes) -> bytes:
        if len(payload) != cls.SIZE:
            raise WireError(f"{{cls.NAME}}: {{cls.SIZE}} bytes expected, got {{len(payload)}}")
        return payload


class Reply(Message):
    """Begins with these two, whatever the command."""

    __slots__ = ()
    status: int
    tick: int


R = TypeVar("R", bound=Reply)


class Command(Message, Generic[R]):
    """A request; ``REPLY`` is the class of its answer, ``REFUSALS`` what a status means for this one alone."""

    __slots__ = ()
    REPLY: ClassVar[type[Any]]
    REFUSALS: ClassVar[dict[int, str]] = {{}}

    @classmethod
    def fitted(cls, payload: bytes) -> bytes:
        """As of every message, but what is beyond must be zero: it would be obeyed in part."""
        if not cls.TAIL and any(payload[cls.SIZE :]):
            raise WireError(f"{{cls.NAME}}: {{cls.SIZE}} bytes expected, got {{len(payload)}}")
        return super().fitted(payload)


def _pack(name: str, layout: struct.Struct, *values: Any) -> bytes:
    try:
        return layout.pack(*values)
    except struct.error as error:
        raise WireError(f"{{name}}: {{error}}") from None


def _exactly(name: str, value: bytes, size: int) -> bytes:
    if len(value) != size:  # struct would cut or pad in silence
        raise WireError(f"{{name}}: {{size}} bytes expected, got {{len(value)}}")
    return value


def _tail(cls: type[Message], value: bytes) -> bytes:
    if cls.SIZE + len(value) > MAX_PAYLOAD:
        raise WireError(f"{{cls.NAME}}: {{len(value)}} bytes do not fit, at most {{MAX_PAYLOAD - cls.SIZE}}")
    return value
'''


def module(schema: Schema) -> str:
    dtypes = "".join(f'    "{f.name}": "<{f.base[0]}{SCALARS[f.base]}",\n' for f in schema.tick)
    preamble = PREAMBLE.format(
        fingerprint=schema.fingerprint,
        version=schema.version,
        revision=schema.revision,
        max_payload=schema.max_payload,
        reply_bit=REPLY_BIT,
        header=_struct_text(schema, schema.header),
        header_names=", ".join(f.name for f in schema.header),
        reply_head=_struct_text(schema, schema.reply_head),
        reply_names=", ".join(f.name for f in schema.reply_head),
        dtypes="{\n" + dtypes + "}",
    )
    blocks = [preamble.rstrip()]
    blocks += [_enum(e) for e in schema.enums.values()]
    for r in schema.records.values():
        blocks.append(_dataclass(schema, class_name(r.name), "Record", r.name, r.doc, r.fields, []))
    replies = {m.name: m for m in schema.messages if m.kind == "reply"}
    for m in schema.messages:
        if m.kind == "request":
            blocks += [_message(schema, replies[m.name]), _message(schema, m)]
        elif m.kind == "stream":
            blocks.append(_message(schema, m))
    table = ["MESSAGES: dict[int, type[Message]] = {"]
    table += [f"    0x{m.number:02X}: {class_name(m.full_name)}," for m in schema.messages]
    table += ["}", '"""By number; a reply\'s is its command\'s with REPLY_BIT set."""']
    blocks.append("\n".join(table))
    return "\n\n\n".join(blocks) + "\n"


def class_name(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _enum(enum: Enum) -> str:
    lines = [f"class {class_name(enum.name)}(IntEnum):", f'    """{enum.doc}."""', ""]
    return "\n".join(lines + [f"    {k.upper()} = {v}" for k, v in enum.values.items()])


def _message(schema: Schema, message: Message) -> str:
    command = f"Command[{class_name(message.name)}Reply]"
    base = {"request": command, "reply": "Reply", "stream": "Message"}[message.kind]
    extra = [f"NUMBER: ClassVar[int] = 0x{message.number:02X}"]
    if message.kind == "request":
        extra.append(f"REPLY: ClassVar[type[Any]] = {class_name(message.name)}Reply")
    if message.refusals:
        rows = [f'    Status.{status.upper()}: "{words}",' for status, words in message.refusals]
        extra += ["REFUSALS: ClassVar[dict[int, str]] = {", *rows, "}"]
    doc = f"The answer to {message.name}" if message.kind == "reply" else message.doc
    name = message.full_name.replace("_request", "").replace("_reply", " reply")
    return _dataclass(schema, class_name(message.full_name), base, name, doc, message.fields, extra)


def _dataclass(
    schema: Schema, cls: str, base: str, name: str, doc: str, fields: tuple[Field, ...], extra: list[str]
) -> str:
    fixed = tuple(f for f in fields if not f.is_tail)
    constants = [f'NAME: ClassVar[str] = "{name}"', *extra, f"SIZE: ClassVar[int] = {schema.size(fields)}"]
    if schema.least(fields) != schema.size(fields):
        constants.append(f"LEAST: ClassVar[int | None] = {schema.least(fields)}")
    if fields and fields[-1].is_tail:
        constants.append("TAIL: ClassVar[bool] = True")
    platform = [f'"{f.name}"' for f in fields if f.platform]
    if platform:
        names = f"{{{', '.join(platform)}}}"
        head = "PLATFORM: ClassVar[frozenset[str]] = frozenset("
        line = f"{head}{names})"
        if len(line) <= 116:
            constants.append(line)
        elif len(names) <= 112:
            constants += [head, f"    {names}", ")"]
        else:
            constants += [head, "    {", *(f"        {name}," for name in platform), "    }", ")"]
    constants.append(f'LAYOUT: ClassVar[struct.Struct] = struct.Struct("{_struct_text(schema, fixed)}")')
    body = [*constants]
    for f in fields:
        body.append(f"{f.name}: {_annotation(f)}{_default(f)}")
        if f.doc:
            body += [line[4:] for line in _docstring(f.doc)]
    body += ["", *_pack(cls, name, fields), "", *_unpack(schema, cls, fields)]
    lines = ["@dataclass(frozen=True, slots=True)", f"class {cls}({base}):", *_docstring(doc), ""]
    return "\n".join(lines + [f"    {line}" if line else "" for line in body])


def _docstring(doc: str) -> list[str]:
    text = doc if doc.endswith(".") else doc + "."
    if len(text) <= 110:
        return [f'    """{text}"""']
    lines = textwrap.wrap(text, 110)
    return [f'    """{lines[0]}', *(f"    {line}" for line in lines[1:]), '    """']


def _annotation(field: Field) -> str:
    if field.is_tail or field.is_blob:
        return "bytes"
    base = "int" if field.base in SCALARS else class_name(field.base)
    return f"tuple[{base}, ...]" if field.count else base


def _default(field: Field) -> str:
    """Of what a revision added: zero is what there was before it."""
    if not field.since:
        return ""
    if field.is_blob:
        return f" = bytes({field.count})"
    zero = "0" if field.base in SCALARS else f"{class_name(field.base)}.unpack(bytes({class_name(field.base)}.SIZE))"
    return f" = ({zero},) * {field.count}" if field.count else f" = {zero}"


def _struct_text(schema: Schema, fields: tuple[Field, ...]) -> str:
    return "<" + "".join(_code(schema, f) for f in fields)


def _code(schema: Schema, field: Field) -> str:
    if field.is_blob:
        return f"{field.count}s"
    if field.base not in SCALARS:  # a record packs itself; the layout around it carries its bytes
        return f"{schema.size((field,))}s"
    return f"{field.count or ''}{CODES[field.base]}"


def _pack(cls: str, name: str, fields: tuple[Field, ...]) -> list[str]:
    values = []
    for f in fields:
        if f.is_tail:
            continue
        if f.is_blob:
            values.append(f'_exactly("{name}.{f.name}", self.{f.name}, {f.count})')
        elif f.base not in SCALARS:
            values.append(f'b"".join(item.pack() for item in self.{f.name})')
        else:
            values.append(f"*self.{f.name}" if f.count else f"self.{f.name}")
    out = ["def pack(self) -> bytes:"]
    for f in fields:
        if f.base not in SCALARS and not f.is_tail:
            out.append(f"    if len(self.{f.name}) != {f.count}:")
            got = f"{{len(self.{f.name})}}"
            out.append(f'        raise WireError(f"{name}: {f.count} {f.name} expected, got {got}")')
    tail = f" + _tail({cls}, self.{fields[-1].name})" if fields and fields[-1].is_tail else ""
    if not fields:
        return [*out, '    return b""']
    return [*out, *_call("_pack", [f"{cls}.NAME", f"{cls}.LAYOUT", *values], tail)]


def _call(function: str, arguments: list[str], tail: str = "") -> list[str]:
    one_line = f"    return {function}({', '.join(arguments)}){tail}"
    if len(one_line) <= 116:
        return [one_line]
    return [f"    return {function}(", *(f"        {a}," for a in arguments), f"    ){tail}"]


def _unpack(schema: Schema, cls: str, fields: tuple[Field, ...]) -> list[str]:
    out = ["@classmethod", f"def unpack(cls, payload: bytes) -> {cls}:", "    payload = cls.fitted(payload)"]
    if not fields:
        return [*out, "    return cls()"]
    if schema.size(fields):
        out.append("    v = cls.LAYOUT.unpack_from(payload)")
    values, at = [], 0
    for f in fields:
        if f.is_tail:
            values.append("payload[cls.SIZE :]")
        elif f.base not in SCALARS:
            size = schema.size(schema.records[f.base].fields)
            item = f"{class_name(f.base)}.unpack(v[{at}][i : i + {size}])"
            values.append(f"tuple({item} for i in range(0, {size * f.count}, {size}))")
            at += 1
        elif f.count and not f.is_blob:
            values.append(f"v[{at}:{at + f.count}]")
            at += f.count
        else:
            values.append(f"v[{at}]")
            at += 1
    return [*out, *_call("cls", values)]
