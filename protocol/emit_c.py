"""Emits firmware/app/wire.h and wire.c."""

from __future__ import annotations

from layout import CRC_SIZE, REPLY_BIT, Field, Schema

C_TYPES = {f"{s}{b}": f"{'u' if s == 'u' else ''}int{b}_t" for s in "ui" for b in (8, 16, 32, 64)}
ORIGIN = "/* generated from protocol/schema.toml by protocol/generate.py */\n/* clang-format off */\n"


def header(schema: Schema) -> str:
    head = schema.size(schema.header)
    out = [
        ORIGIN,
        "#ifndef PHASELEAD_APP_WIRE_H\n#define PHASELEAD_APP_WIRE_H\n",
        "#include <stdbool.h>\n#include <stddef.h>\n#include <stdint.h>\n",
        "/* Sizes in bytes; *_SIZE of a message or record is that of its fixed part on the line. */",
        f"#define WIRE_FINGERPRINT 0x{schema.fingerprint:08X}u",
        f"#define WIRE_VERSION {schema.version}",
        f"#define WIRE_REVISION {schema.revision}",
        f"#define WIRE_MAX_PAYLOAD {schema.max_payload}",
        f"#define WIRE_HEADER_SIZE {head}",
        f"#define WIRE_CRC_SIZE {CRC_SIZE}",
        "#define WIRE_MAX_BODY (WIRE_HEADER_SIZE + WIRE_MAX_PAYLOAD + WIRE_CRC_SIZE)",
        f"#define WIRE_REPLY_BIT 0x{REPLY_BIT:02X}",
        "",
        *_message_numbers(schema),
        *_enums(schema),
        *_commands(schema),
        *_structs(schema),
        "/* Size without what revisions added, and with it; bytes may follow a message with a tail. */",
        "struct wire_message_size {\n    uint16_t least;\n    uint16_t fixed;\n    bool has_tail;\n};\n",
        "/* NULL for a number that is no message. */",
        "const struct wire_message_size *wire_message_size(uint8_t type);",
        "/* For messages; NULL for a number that is no message. A reply has its command's name. */",
        "const char *wire_message_name(uint8_t type);\n",
        "/* Bytes of one axis in one tick of a samples batch. */",
        "size_t wire_tick_size(uint8_t channels);",
        "/* Writes the chosen channels of one axis; returns the end of what was written. */",
        "uint8_t *wire_put_tick(uint8_t *out, uint8_t channels, const struct wire_tick *tick);\n",
        "/* Packing returns the bytes written, or -1 when `capacity` or WIRE_MAX_PAYLOAD does not hold them.",
        " * Unpacking returns false unless `size` is right; a tail points into `in`. */",
    ]
    for name in _codec_names(schema):
        out.append(f"{_pack_signature(name)};")
        out.append(f"{_unpack_signature(name)};")
    out.append("\n#endif")
    return "\n".join(out) + "\n"


def _message_numbers(schema: Schema) -> list[str]:
    out = ["enum wire_type {"]
    out += [f"    WIRE_{m.name.upper()} = 0x{m.number:02X}," for m in schema.messages if m.kind != "reply"]
    return [*out, "};", ""]


def _enums(schema: Schema) -> list[str]:
    out = []
    for enum in schema.enums.values():
        out.append(f"/* {enum.doc} */")
        out.append(f"enum wire_{enum.name} {{")
        out += [f"    WIRE_{enum.name.upper()}_{k.upper()} = {v}," for k, v in enum.values.items()]
        out += ["};", f"#define WIRE_{enum.name.upper()}_COUNT {len(enum.values)}", ""]
    return out


def _commands(schema: Schema) -> list[str]:
    out = [
        "/* Every command as COMMAND(name, number, mask of the states it is allowed in, whether it locks the device",
        " * itself); app/commands.c makes its table of them. */",
        "#define WIRE_ANY_STATE ((1u << WIRE_STATE_COUNT) - 1)",
    ]
    rows = []
    for m in schema.messages:
        if m.kind == "request":
            states = " | ".join(f"1u << WIRE_STATE_{state.upper()}" for state in m.states) or "WIRE_ANY_STATE"
            rows.append(f"    COMMAND({m.name}, WIRE_{m.name.upper()}, {states}, {str(m.locks_itself).lower()})")
    return [*out, " \\\n".join(["#define WIRE_COMMANDS(COMMAND)", *rows]), ""]


def _structs(schema: Schema) -> list[str]:
    out = []
    for name, doc, fields in _struct_list(schema):
        size = schema.size(fields)
        out += [f"/* {doc} */", f"#define WIRE_{name.upper()}_SIZE {size}"]
        out += [f"struct wire_{name} {{", *(_member(f) for f in fields), "};", ""]
    for m in schema.messages:
        if m.kind == "request" and not m.fields:
            out.append(f"#define WIRE_{m.full_name.upper()}_SIZE 0 /* {m.doc} */")
        if m.kind == "reply" and m.fields == schema.reply_head:
            out.append(f"#define WIRE_{m.full_name.upper()}_SIZE WIRE_REPLY_HEAD_SIZE")
    return [*out, ""]


def _struct_list(schema: Schema) -> list[tuple[str, str, tuple[Field, ...]]]:
    """Everything with a struct of its own; no fields, or a reply's head alone, need none."""
    out = [("header", "Before every payload", schema.header)]
    out.append(("reply_head", "What every reply begins with; most are no more", schema.reply_head))
    out.append(("tick", "One axis in one tick of a samples batch", schema.tick))
    out += [(r.name, r.doc, r.fields) for r in schema.records.values()]
    messages = [m for m in schema.messages if m.fields and m.fields != schema.reply_head]
    out += [(m.full_name, f"0x{m.number:02X}: {m.doc}", m.fields) for m in messages]
    return out


def _codec_names(schema: Schema) -> list[str]:
    return [name for name, _, _ in _struct_list(schema) if name != "tick"]


def _member(field: Field) -> str:
    note = f" /* {field.doc} */" if field.doc else ""
    if field.is_tail:
        return f"    const uint8_t *{field.name};{note}\n    size_t {field.name}_size;"
    base = C_TYPES.get(field.base, f"struct wire_{field.base}")
    return f"    {base} {field.name}{f'[{field.count}]' if field.count else ''};{note}"


def _pack_signature(name: str) -> str:
    return f"int32_t wire_pack_{name}(const struct wire_{name} *from, uint8_t *out, size_t capacity)"


def _unpack_signature(name: str) -> str:
    return f"bool wire_unpack_{name}(struct wire_{name} *to, const uint8_t *in, size_t size)"


PREAMBLE = """\
static uint8_t *put_u8(uint8_t *out, uint8_t value)
{
    *out = value;
    return out + 1;
}

static uint8_t *put_u16(uint8_t *out, uint16_t value)
{
    return put_u8(put_u8(out, (uint8_t)value), (uint8_t)(value >> 8));
}

static uint8_t *put_u32(uint8_t *out, uint32_t value)
{
    return put_u16(put_u16(out, (uint16_t)value), (uint16_t)(value >> 16));
}

static uint8_t *put_u64(uint8_t *out, uint64_t value)
{
    return put_u32(put_u32(out, (uint32_t)value), (uint32_t)(value >> 32));
}

static uint8_t *put_bytes(uint8_t *out, const uint8_t *bytes, size_t size)
{
    if (size > 0) /* memcpy may not be given NULL, not even for nothing */
        memcpy(out, bytes, size);
    return out + size;
}

static uint8_t get_u8(const uint8_t **in)
{
    return *(*in)++;
}

static uint16_t get_u16(const uint8_t **in)
{
    uint16_t low = get_u8(in);
    return (uint16_t)(low | get_u8(in) << 8);
}

static uint32_t get_u32(const uint8_t **in)
{
    uint32_t low = get_u16(in);
    return low | (uint32_t)get_u16(in) << 16;
}

static uint64_t get_u64(const uint8_t **in)
{
    uint64_t low = get_u32(in);
    return low | (uint64_t)get_u32(in) << 32;
}

static void get_bytes(const uint8_t **in, uint8_t *bytes, size_t size)
{
    memcpy(bytes, *in, size);
    *in += size;
}
"""

LOOKUP = """\
const struct wire_message_size *wire_message_size(uint8_t type)
{
    for (size_t i = 0; i < sizeof MESSAGES / sizeof MESSAGES[0]; i++)
        if (MESSAGES[i].type == type)
            return &MESSAGES[i].size;
    return NULL;
}

const char *wire_message_name(uint8_t type)
{
    for (size_t i = 0; i < sizeof MESSAGES / sizeof MESSAGES[0]; i++)
        if (MESSAGES[i].type == type)
            return MESSAGES[i].name;
    return NULL;
}
"""


def source(schema: Schema) -> str:
    out = [ORIGIN, '#include "app/wire.h"\n\n#include <string.h>\n', PREAMBLE]
    out += ["static const struct {", "    const char *name;", "    struct wire_message_size size;"]
    out += ["    uint8_t type;", "} MESSAGES[] = {"]
    for m in schema.messages:
        tail = "true" if m.tail else "false"
        out.append(
            f'    {{"{m.name}", {{{schema.least(m.fields)}, {schema.size(m.fields)}, {tail}}}, 0x{m.number:02X}}},'
        )
    out += ["};\n", LOOKUP, *_tick(schema)]
    for name, _, fields in _struct_list(schema):
        if name != "tick":
            out += [*_pack(schema, name, fields), *_unpack(schema, name, fields)]
    return "\n".join(out).rstrip() + "\n"


def _tick(schema: Schema) -> list[str]:
    bit = "WIRE_CHANNEL_{}".format
    out = ["size_t wire_tick_size(uint8_t channels)", "{", "    size_t size = 0;"]
    for f in schema.tick:
        out.append(f"    size += channels & {bit(f.name.upper())} ? {schema.size((f,))} : 0;")
    out += ["    return size;", "}", ""]
    out += ["uint8_t *wire_put_tick(uint8_t *out, uint8_t channels, const struct wire_tick *tick)", "{"]
    for f in schema.tick:
        out += [f"    if (channels & {bit(f.name.upper())})", f"        out = {_put(f, f'tick->{f.name}')};"]
    return [*out, "    return out;", "}", ""]


def _put(field: Field, value: str) -> str:
    cast = f"({C_TYPES['u' + field.base[1:]]})" if field.base[0] == "i" else ""
    return f"put_u{field.base[1:]}(out, {cast}{value})"


def _get(field: Field) -> str:
    cast = f"({C_TYPES[field.base]})" if field.base[0] == "i" else ""
    return f"{cast}get_u{field.base[1:]}(&in)"


def _pack(schema: Schema, name: str, fields: tuple[Field, ...]) -> list[str]:
    size_macro = f"WIRE_{name.upper()}_SIZE"
    out = [_pack_signature(name), "{"]
    tail = fields[-1] if fields[-1].is_tail else None
    if tail:
        out.append(f"    if (from->{tail.name}_size > WIRE_MAX_PAYLOAD - {size_macro} ||")
        out.append(f"        capacity < {size_macro} + from->{tail.name}_size)")
    else:
        out.append(f"    if (capacity < {size_macro})")
    out.append("        return -1;")
    for f in fields:
        member = f"from->{f.name}"
        moves_on = "" if f is fields[-1] else "out = "
        if f.is_tail:
            out.append(f"    {moves_on}put_bytes(out, {member}, {member}_size);")
        elif f.base == "u8" and f.count:
            out.append(f"    {moves_on}put_bytes(out, {member}, {f.count});")
        elif f.base in C_TYPES and f.count:
            out += _loop(f, [f"out = {_put(f, f'{member}[i]')};"])
        elif f.base in C_TYPES:
            out.append(f"    {moves_on}{_put(f, member)};")
        else:
            sub = f"WIRE_{f.base.upper()}_SIZE"
            out += _loop(f, [f"wire_pack_{f.base}(&{member}[i], out, {sub});", f"out += {sub};"])
    total = f"(int32_t)({size_macro} + from->{tail.name}_size)" if tail else size_macro
    return [*out, f"    return {total};", "}", ""]


def _unpack(schema: Schema, name: str, fields: tuple[Field, ...]) -> list[str]:
    size_macro = f"WIRE_{name.upper()}_SIZE"
    out = [_unpack_signature(name), "{"]
    tail = fields[-1].is_tail
    condition = f"size < {size_macro} || size > WIRE_MAX_PAYLOAD" if tail else f"size != {size_macro}"
    out += [f"    if ({condition})", "        return false;"]
    for f in fields:
        member = f"to->{f.name}"
        if f.is_tail:
            out += [f"    {member} = in;", f"    {member}_size = size - {size_macro};"]
        elif f.base == "u8" and f.count:
            out.append(f"    get_bytes(&in, {member}, {f.count});")
        elif f.base in C_TYPES and f.count:
            out += _loop(f, [f"{member}[i] = {_get(f)};"])
        elif f.base in C_TYPES:
            out.append(f"    {member} = {_get(f)};")
        else:
            sub = f"WIRE_{f.base.upper()}_SIZE"
            out += _loop(f, [f"wire_unpack_{f.base}(&{member}[i], in, {sub});", f"in += {sub};"])
    return [*out, "    return true;", "}", ""]


def _loop(field: Field, body: list[str]) -> list[str]:
    if not field.count:
        raise NotImplementedError(f"{field.name}: a single record inside a record")
    head = f"    for (size_t i = 0; i < {field.count}; i++)"
    lines = [f"        {line}" for line in body]
    return [head, *lines] if len(lines) == 1 else [f"{head} {{", *lines, "    }"]
