"""Emits docs/wire.md."""

from __future__ import annotations

from layout import Field, Message, Schema

INTRODUCTION = """\
<!-- generated from protocol/schema.toml by protocol/generate.py -->
# The wire

Host and device exchange frames over a serial line of 8 data bits, no parity, one stop bit.

    frame = COBS( header  payload  crc32 ) 0x00

Numbers are little-endian. COBS (consistent overhead byte stuffing) removes the zero bytes, so a zero ends a
frame and nothing else: a reader that has lost its place finds it again at the next zero. The CRC is
CRC-32/ISO-HDLC (polynomial 0x04C11DB7 reflected, initial value and final exclusive-or 0xFFFFFFFF, check value
0xCBF43926) over header and payload, appended little-endian. A frame that fails COBS, CRC or length is counted
and dropped without an answer.

A payload has at most {max_payload} bytes.

## Versions

This is version {version}, revision {revision}, of the wire; its fingerprint is `0x{fingerprint:08X}`. HELLO's reply
begins with fingerprint, version and revision, in every version from 2 on.

A **revision** adds to the version: commands, stream messages, values of an enumeration, fields at the end of a message.
What is added is no part of the fingerprint, and zero in an added field means what there was before it. Host and device
with the same fingerprint are neighbours and talk, whichever is newer:

- a message that is shorter than its reader knows it is filled up with zeros;
- of a reply or a stream message that is longer, the reader leaves out what it does not know;
- of a request that is longer, the device obeys what it knows if the rest is zero, else it answers `bad_length`: a
  command that asks for more than the device knows is refused and not obeyed in part;
- a command that the device does not know is answered with `unknown_command`.

Anything else makes another **version**, with another fingerprint, and the host refuses it at HELLO: it says to flash
the firmware when the device's version is the lower one, and to update phaselead when it is the higher one. The model is
a record: its layout only changes with the version.

## Sessions, commands and retries

The host opens a session by sending HELLO with a random 64-bit number in the header's `session`, which the
device keeps in RAM. Every other command but STOP is refused with `no_session` unless it carries that number:
a device that has restarted, or that another host has taken over, says so instead of obeying. The same HELLO
may be repeated.

A reply has its command's number plus 0x80 and repeats its `id` and `session`. A host that sees no reply sends
the very same frame again; the device recognises session and id, does not execute the command twice, and repeats its
reply. A reply begins with `status` and `tick`; when the status is not `ok` it may end there.

Ids count up from 1, and 1 follows 65535. The device remembers which of the last 64 it has executed and keeps the last
8 replies; it drops a copy whose reply is no longer kept, and whatever lies further back. Two things are done again for
each copy that comes: STOP, and reads whose reply has more than 128 bytes. [The link](link.md) says how that was tried.

Stream messages (samples, events) are sent without being asked for and never repeated. Samples carry `id` 0; the `id`
of events counts them, so that a lost one leaves a hole in the numbers.

## Header

{header}
## Messages

{index}
"""


def document(schema: Schema) -> str:
    index = ["| number | message | | bytes |", "|---|---|---|---|"]
    for m in schema.messages:
        if m.kind != "reply":
            size = f"{schema.size(m.fields)}{' + data' if m.tail else ''}"
            index.append(f"| 0x{m.number:02X} | [{m.name}](#{m.name}) | {_cell(m.doc)} | {size} |")
    out = [
        INTRODUCTION.format(
            max_payload=schema.max_payload,
            fingerprint=schema.fingerprint,
            version=schema.version,
            revision=schema.revision,
            header=_table(schema, schema.header),
            index="\n".join(index),
        )
    ]
    for m in schema.messages:
        out += _message(schema, m)
    out.append("## One axis in one tick\n")
    out.append("`data` of a samples message, for each tick and each axis of the mask; a field is there when its")
    out.append(f"bit of [channel](#channel) is set.\n\n{_table(schema, schema.tick)}")
    out.append("## Records\n")
    for r in schema.records.values():
        out.append(f"### {r.name}\n\n{_sentence(r.doc)} {schema.size(r.fields)} bytes.\n")
        out.append(_table(schema, r.fields))
    out.append("## Enumerations\n")
    for e in schema.enums.values():
        out.append(f"### {e.name}\n\n{_sentence(e.doc)}\n")
        out += ["| value | name |", "|---|---|", *(f"| {v} | {k} |" for k, v in e.values.items()), ""]
    return "\n".join(out).rstrip() + "\n"


def _message(schema: Schema, message: Message) -> list[str]:
    out = []
    if message.kind == "reply":
        out.append(f"Reply, 0x{message.number:02X}:\n")
    else:
        out.append(f"### {message.name}\n\n{_sentence(message.doc)}\n")
        what = "Stream message" if message.kind == "stream" else "Request"
        out.append(f"{what}, 0x{message.number:02X}{':' if message.fields else ': no payload.'}\n")
    if message.fields:
        out.append(_table(schema, message.fields))
    return out


def _sentence(text: str) -> str:
    return text if text.endswith(".") else text + "."


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _table(schema: Schema, fields: tuple[Field, ...]) -> str:
    out, at = ["| offset | field | type | meaning |", "|---|---|---|---|"], 0
    for f in fields:
        notes = [_cell(f.doc)] if f.doc else []
        if f.enum:
            notes.append(f"[{f.enum}](#{f.enum})")
        if f.platform:
            notes.append("differs between builds")
        if f.since:
            notes.append(f"since revision {f.since}")
        is_record = f.base in schema.records
        base = f"[{f.base}](#{f.base}){f.type_text[len(f.base) :]}" if is_record else f.type_text
        out.append(f"| {at} | `{f.name}` | {base} | {'; '.join(notes)} |")
        at += schema.size((f,))
    return "\n".join(out) + "\n"
