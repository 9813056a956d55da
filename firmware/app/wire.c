/* generated from protocol/schema.toml by protocol/generate.py */
/* clang-format off */

#include "app/wire.h"

#include <string.h>

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

static const struct {
    const char *name;
    struct wire_message_size size;
    uint8_t type;
} MESSAGES[] = {
    {"hello", {0, 0, false}, 0x01},
    {"hello", {79, 79, false}, 0x81},
    {"stop", {0, 0, false}, 0x02},
    {"stop", {9, 9, false}, 0x82},
    {"status", {0, 0, false}, 0x03},
    {"status", {65, 73, false}, 0x83},
    {"arm", {4, 4, false}, 0x04},
    {"arm", {9, 9, false}, 0x84},
    {"start", {1, 1, false}, 0x05},
    {"start", {17, 17, false}, 0x85},
    {"park", {0, 0, false}, 0x06},
    {"park", {9, 9, false}, 0x86},
    {"clear_fault", {0, 0, false}, 0x07},
    {"clear_fault", {9, 9, false}, 0x87},
    {"set_axis", {18, 58, false}, 0x08},
    {"set_axis", {9, 9, false}, 0x88},
    {"set_path", {26, 26, false}, 0x09},
    {"set_path", {17, 17, false}, 0x89},
    {"wave_chunk", {3, 3, true}, 0x0A},
    {"wave_chunk", {9, 9, false}, 0x8A},
    {"wave_commit", {5, 13, false}, 0x0B},
    {"wave_commit", {9, 9, false}, 0x8B},
    {"model_begin", {8, 8, false}, 0x0C},
    {"model_begin", {9, 9, false}, 0x8C},
    {"model_chunk", {4, 4, true}, 0x0D},
    {"model_chunk", {9, 9, false}, 0x8D},
    {"model_commit", {0, 0, false}, 0x0E},
    {"model_commit", {12, 12, false}, 0x8E},
    {"model_read", {6, 6, false}, 0x0F},
    {"model_read", {17, 17, true}, 0x8F},
    {"model_persist", {0, 0, false}, 0x10},
    {"model_persist", {13, 13, false}, 0x90},
    {"stream_start", {4, 4, false}, 0x11},
    {"stream_start", {21, 21, false}, 0x91},
    {"stream_stop", {0, 0, false}, 0x12},
    {"stream_stop", {25, 25, false}, 0x92},
    {"snapshot_read", {7, 7, false}, 0x13},
    {"snapshot_read", {13, 13, true}, 0x93},
    {"set_timeout", {4, 4, false}, 0x14},
    {"set_timeout", {9, 9, false}, 0x94},
    {"info", {0, 0, false}, 0x15},
    {"info", {103, 108, false}, 0x95},
    {"motion", {33, 33, false}, 0x40},
    {"motion", {9, 9, false}, 0xC0},
    {"queue", {100, 101, false}, 0x41},
    {"queue", {12, 12, false}, 0xC1},
    {"set_joins", {6, 6, false}, 0x44},
    {"set_joins", {9, 9, false}, 0xC4},
    {"points_begin", {18, 18, false}, 0x45},
    {"points_begin", {9, 9, false}, 0xC5},
    {"points", {13, 13, true}, 0x46},
    {"points", {15, 15, false}, 0xC6},
    {"trigger_set", {12, 12, false}, 0x47},
    {"trigger_set", {9, 9, false}, 0xC7},
    {"set_gains", {17, 57, false}, 0x42},
    {"set_gains", {9, 9, false}, 0xC2},
    {"where", {0, 0, false}, 0x43},
    {"where", {72, 96, false}, 0xC3},
    {"update_info", {0, 0, false}, 0x30},
    {"update_info", {28, 28, false}, 0xB0},
    {"update_begin", {64, 64, false}, 0x31},
    {"update_begin", {9, 9, false}, 0xB1},
    {"update_chunk", {4, 4, true}, 0x32},
    {"update_chunk", {9, 9, false}, 0xB2},
    {"update_commit", {0, 0, false}, 0x33},
    {"update_commit", {9, 9, false}, 0xB3},
    {"update_restart", {0, 0, false}, 0x34},
    {"update_restart", {9, 9, false}, 0xB4},
    {"update_confirm", {20, 20, false}, 0x35},
    {"update_confirm", {9, 9, false}, 0xB5},
    {"limits_set", {36, 36, false}, 0x20},
    {"limits_set", {9, 9, false}, 0xA0},
    {"limits_read", {0, 0, false}, 0x21},
    {"limits_read", {46, 46, false}, 0xA1},
    {"fault_log", {0, 0, false}, 0x22},
    {"fault_log", {318, 318, false}, 0xA2},
    {"transient_arm", {12, 12, false}, 0x23},
    {"transient_arm", {11, 11, false}, 0xA3},
    {"transient_read", {6, 6, false}, 0x24},
    {"transient_read", {28, 28, true}, 0xA4},
    {"samples", {20, 20, true}, 0x70},
    {"event", {13, 13, false}, 0x71},
};

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

size_t wire_tick_size(uint8_t channels)
{
    size_t size = 0;
    size += channels & WIRE_CHANNEL_REFERENCE ? 4 : 0;
    size += channels & WIRE_CHANNEL_ADC ? 2 : 0;
    size += channels & WIRE_CHANNEL_DAC ? 2 : 0;
    size += channels & WIRE_CHANNEL_FEEDFORWARD ? 2 : 0;
    size += channels & WIRE_CHANNEL_FEEDBACK ? 2 : 0;
    size += channels & WIRE_CHANNEL_TRIGGER ? 1 : 0;
    return size;
}

uint8_t *wire_put_tick(uint8_t *out, uint8_t channels, const struct wire_tick *tick)
{
    if (channels & WIRE_CHANNEL_REFERENCE)
        out = put_u32(out, (uint32_t)tick->reference);
    if (channels & WIRE_CHANNEL_ADC)
        out = put_u16(out, tick->adc);
    if (channels & WIRE_CHANNEL_DAC)
        out = put_u16(out, tick->dac);
    if (channels & WIRE_CHANNEL_FEEDFORWARD)
        out = put_u16(out, (uint16_t)tick->feedforward);
    if (channels & WIRE_CHANNEL_FEEDBACK)
        out = put_u16(out, (uint16_t)tick->feedback);
    if (channels & WIRE_CHANNEL_TRIGGER)
        out = put_u8(out, tick->trigger);
    return out;
}

int32_t wire_pack_header(const struct wire_header *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_HEADER_SIZE)
        return -1;
    out = put_u8(out, from->type);
    out = put_u16(out, from->id);
    put_u64(out, from->session);
    return WIRE_HEADER_SIZE;
}

bool wire_unpack_header(struct wire_header *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_HEADER_SIZE)
        return false;
    to->type = get_u8(&in);
    to->id = get_u16(&in);
    to->session = get_u64(&in);
    return true;
}

int32_t wire_pack_reply_head(const struct wire_reply_head *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_REPLY_HEAD_SIZE)
        return -1;
    out = put_u8(out, from->status);
    put_u64(out, from->tick);
    return WIRE_REPLY_HEAD_SIZE;
}

bool wire_unpack_reply_head(struct wire_reply_head *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_REPLY_HEAD_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    return true;
}

int32_t wire_pack_biquad(const struct wire_biquad *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_BIQUAD_SIZE)
        return -1;
    out = put_u32(out, (uint32_t)from->b0_q26);
    out = put_u32(out, (uint32_t)from->b1_q26);
    out = put_u32(out, (uint32_t)from->b2_q26);
    out = put_u32(out, (uint32_t)from->a1_q26);
    put_u32(out, (uint32_t)from->a2_q26);
    return WIRE_BIQUAD_SIZE;
}

bool wire_unpack_biquad(struct wire_biquad *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_BIQUAD_SIZE)
        return false;
    to->b0_q26 = (int32_t)get_u32(&in);
    to->b1_q26 = (int32_t)get_u32(&in);
    to->b2_q26 = (int32_t)get_u32(&in);
    to->a1_q26 = (int32_t)get_u32(&in);
    to->a2_q26 = (int32_t)get_u32(&in);
    return true;
}

int32_t wire_pack_axis_model(const struct wire_axis_model *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_AXIS_MODEL_SIZE)
        return -1;
    out = put_u32(out, from->flags);
    out = put_u32(out, (uint32_t)from->u_min_q24);
    out = put_u32(out, (uint32_t)from->u_max_q24);
    out = put_u32(out, (uint32_t)from->u_park_q24);
    out = put_u32(out, (uint32_t)from->slew_q24);
    out = put_u32(out, (uint32_t)from->ramp_q24);
    out = put_u32(out, (uint32_t)from->dac_zero_code);
    out = put_u32(out, (uint32_t)from->dac_codes_per_V_q16);
    out = put_u32(out, (uint32_t)from->adc_zero_code);
    out = put_u32(out, (uint32_t)from->adc_um_per_code_q32);
    out = put_u32(out, (uint32_t)from->swing_min_q24);
    out = put_u32(out, (uint32_t)from->swing_max_q24);
    out = put_u32(out, (uint32_t)from->f_min_q16);
    out = put_u32(out, (uint32_t)from->f_max_q16);
    for (size_t i = 0; i < 3; i++)
        out = put_u64(out, (uint64_t)from->a_q32[i]);
    for (size_t i = 0; i < 6; i++)
        out = put_u64(out, (uint64_t)from->b_q40[i]);
    for (size_t i = 0; i < 6; i++)
        out = put_u64(out, (uint64_t)from->c_q32[i]);
    out = put_u32(out, from->preview_ticks_q16);
    for (size_t i = 0; i < 6; i++) {
        wire_pack_biquad(&from->shape[i], out, WIRE_BIQUAD_SIZE);
        out += WIRE_BIQUAD_SIZE;
    }
    for (size_t i = 0; i < 1; i++) {
        wire_pack_biquad(&from->drive[i], out, WIRE_BIQUAD_SIZE);
        out += WIRE_BIQUAD_SIZE;
    }
    for (size_t i = 0; i < 8; i++)
        out = put_u32(out, (uint32_t)from->creep_k_q30[i]);
    for (size_t i = 0; i < 8; i++)
        out = put_u64(out, (uint64_t)from->creep_alpha_q48[i]);
    out = put_u32(out, (uint32_t)from->gain_q20);
    out = put_u32(out, (uint32_t)from->offset_q16);
    out = put_u32(out, (uint32_t)from->rest_fraction_q30);
    for (size_t i = 0; i < 32; i++)
        out = put_u32(out, (uint32_t)from->play_r_q24[i]);
    for (size_t i = 0; i < 32; i++)
        out = put_u32(out, (uint32_t)from->play_w_q20[i]);
    for (size_t i = 0; i < 24; i++)
        out = put_u32(out, (uint32_t)from->knot_d_q24[i]);
    for (size_t i = 0; i < 24; i++)
        out = put_u32(out, (uint32_t)from->knot_s_q20[i]);
    for (size_t i = 0; i < 3; i++)
        out = put_u32(out, (uint32_t)from->coupling_q28[i]);
    out = put_u32(out, (uint32_t)from->error_limit_q16);
    out = put_u32(out, from->error_ticks);
    put_u32(out, (uint32_t)from->oscillation_limit_q16);
    return WIRE_AXIS_MODEL_SIZE;
}

bool wire_unpack_axis_model(struct wire_axis_model *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_AXIS_MODEL_SIZE)
        return false;
    to->flags = get_u32(&in);
    to->u_min_q24 = (int32_t)get_u32(&in);
    to->u_max_q24 = (int32_t)get_u32(&in);
    to->u_park_q24 = (int32_t)get_u32(&in);
    to->slew_q24 = (int32_t)get_u32(&in);
    to->ramp_q24 = (int32_t)get_u32(&in);
    to->dac_zero_code = (int32_t)get_u32(&in);
    to->dac_codes_per_V_q16 = (int32_t)get_u32(&in);
    to->adc_zero_code = (int32_t)get_u32(&in);
    to->adc_um_per_code_q32 = (int32_t)get_u32(&in);
    to->swing_min_q24 = (int32_t)get_u32(&in);
    to->swing_max_q24 = (int32_t)get_u32(&in);
    to->f_min_q16 = (int32_t)get_u32(&in);
    to->f_max_q16 = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 3; i++)
        to->a_q32[i] = (int64_t)get_u64(&in);
    for (size_t i = 0; i < 6; i++)
        to->b_q40[i] = (int64_t)get_u64(&in);
    for (size_t i = 0; i < 6; i++)
        to->c_q32[i] = (int64_t)get_u64(&in);
    to->preview_ticks_q16 = get_u32(&in);
    for (size_t i = 0; i < 6; i++) {
        wire_unpack_biquad(&to->shape[i], in, WIRE_BIQUAD_SIZE);
        in += WIRE_BIQUAD_SIZE;
    }
    for (size_t i = 0; i < 1; i++) {
        wire_unpack_biquad(&to->drive[i], in, WIRE_BIQUAD_SIZE);
        in += WIRE_BIQUAD_SIZE;
    }
    for (size_t i = 0; i < 8; i++)
        to->creep_k_q30[i] = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 8; i++)
        to->creep_alpha_q48[i] = (int64_t)get_u64(&in);
    to->gain_q20 = (int32_t)get_u32(&in);
    to->offset_q16 = (int32_t)get_u32(&in);
    to->rest_fraction_q30 = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 32; i++)
        to->play_r_q24[i] = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 32; i++)
        to->play_w_q20[i] = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 24; i++)
        to->knot_d_q24[i] = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 24; i++)
        to->knot_s_q20[i] = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 3; i++)
        to->coupling_q28[i] = (int32_t)get_u32(&in);
    to->error_limit_q16 = (int32_t)get_u32(&in);
    to->error_ticks = get_u32(&in);
    to->oscillation_limit_q16 = (int32_t)get_u32(&in);
    return true;
}

int32_t wire_pack_segment(const struct wire_segment *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_SEGMENT_SIZE)
        return -1;
    out = put_u8(out, from->path);
    out = put_u8(out, from->flags);
    out = put_u32(out, (uint32_t)from->swing);
    out = put_u32(out, (uint32_t)from->offset);
    out = put_u64(out, from->step_turn64);
    out = put_u64(out, from->ticks);
    out = put_u16(out, from->enter_ticks);
    put_u16(out, from->leave_ticks);
    return WIRE_SEGMENT_SIZE;
}

bool wire_unpack_segment(struct wire_segment *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_SEGMENT_SIZE)
        return false;
    to->path = get_u8(&in);
    to->flags = get_u8(&in);
    to->swing = (int32_t)get_u32(&in);
    to->offset = (int32_t)get_u32(&in);
    to->step_turn64 = get_u64(&in);
    to->ticks = get_u64(&in);
    to->enter_ticks = get_u16(&in);
    to->leave_ticks = get_u16(&in);
    return true;
}

int32_t wire_pack_model(const struct wire_model *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_MODEL_SIZE)
        return -1;
    out = put_u32(out, from->magic);
    out = put_bytes(out, from->stage_hash, 32);
    for (size_t i = 0; i < 3; i++) {
        wire_pack_axis_model(&from->axes[i], out, WIRE_AXIS_MODEL_SIZE);
        out += WIRE_AXIS_MODEL_SIZE;
    }
    return WIRE_MODEL_SIZE;
}

bool wire_unpack_model(struct wire_model *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_MODEL_SIZE)
        return false;
    to->magic = get_u32(&in);
    get_bytes(&in, to->stage_hash, 32);
    for (size_t i = 0; i < 3; i++) {
        wire_unpack_axis_model(&to->axes[i], in, WIRE_AXIS_MODEL_SIZE);
        in += WIRE_AXIS_MODEL_SIZE;
    }
    return true;
}

int32_t wire_pack_axis_limits(const struct wire_axis_limits *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_AXIS_LIMITS_SIZE)
        return -1;
    out = put_u16(out, from->dac_min);
    out = put_u16(out, from->dac_max);
    out = put_u32(out, from->slew_codes_q16);
    out = put_u16(out, from->adc_min);
    put_u16(out, from->adc_max);
    return WIRE_AXIS_LIMITS_SIZE;
}

bool wire_unpack_axis_limits(struct wire_axis_limits *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_AXIS_LIMITS_SIZE)
        return false;
    to->dac_min = get_u16(&in);
    to->dac_max = get_u16(&in);
    to->slew_codes_q16 = get_u32(&in);
    to->adc_min = get_u16(&in);
    to->adc_max = get_u16(&in);
    return true;
}

int32_t wire_pack_logged_fault(const struct wire_logged_fault *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_LOGGED_FAULT_SIZE)
        return -1;
    out = put_u32(out, from->power_cycle);
    out = put_u64(out, from->tick);
    out = put_u32(out, from->detail);
    out = put_u8(out, from->fault);
    out = put_u8(out, from->axis);
    put_u8(out, from->state);
    return WIRE_LOGGED_FAULT_SIZE;
}

bool wire_unpack_logged_fault(struct wire_logged_fault *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_LOGGED_FAULT_SIZE)
        return false;
    to->power_cycle = get_u32(&in);
    to->tick = get_u64(&in);
    to->detail = get_u32(&in);
    to->fault = get_u8(&in);
    to->axis = get_u8(&in);
    to->state = get_u8(&in);
    return true;
}

int32_t wire_pack_device_record(const struct wire_device_record *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_DEVICE_RECORD_SIZE)
        return -1;
    out = put_u32(out, from->magic);
    out = put_u32(out, from->sequence);
    out = put_u32(out, from->power_cycle);
    out = put_u8(out, from->limits_lost);
    for (size_t i = 0; i < 3; i++) {
        wire_pack_axis_limits(&from->limits[i], out, WIRE_AXIS_LIMITS_SIZE);
        out += WIRE_AXIS_LIMITS_SIZE;
    }
    for (size_t i = 0; i < 1; i++) {
        wire_pack_logged_fault(&from->fault[i], out, WIRE_LOGGED_FAULT_SIZE);
        out += WIRE_LOGGED_FAULT_SIZE;
    }
    return WIRE_DEVICE_RECORD_SIZE;
}

bool wire_unpack_device_record(struct wire_device_record *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_DEVICE_RECORD_SIZE)
        return false;
    to->magic = get_u32(&in);
    to->sequence = get_u32(&in);
    to->power_cycle = get_u32(&in);
    to->limits_lost = get_u8(&in);
    for (size_t i = 0; i < 3; i++) {
        wire_unpack_axis_limits(&to->limits[i], in, WIRE_AXIS_LIMITS_SIZE);
        in += WIRE_AXIS_LIMITS_SIZE;
    }
    for (size_t i = 0; i < 1; i++) {
        wire_unpack_logged_fault(&to->fault[i], in, WIRE_LOGGED_FAULT_SIZE);
        in += WIRE_LOGGED_FAULT_SIZE;
    }
    return true;
}

int32_t wire_pack_hello_reply(const struct wire_hello_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_HELLO_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u32(out, from->schema_fingerprint);
    out = put_u16(out, from->wire_version);
    out = put_u16(out, from->wire_revision);
    out = put_bytes(out, from->build_id, 20);
    out = put_bytes(out, from->target, 24);
    out = put_u32(out, from->tick_rate_Hz);
    out = put_u32(out, from->baud);
    out = put_u8(out, from->axis_count);
    out = put_u8(out, from->state);
    out = put_u8(out, from->reset_cause);
    out = put_u8(out, from->model_flags);
    out = put_u32(out, from->model_crc);
    put_u16(out, from->max_payload);
    return WIRE_HELLO_REPLY_SIZE;
}

bool wire_unpack_hello_reply(struct wire_hello_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_HELLO_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->schema_fingerprint = get_u32(&in);
    to->wire_version = get_u16(&in);
    to->wire_revision = get_u16(&in);
    get_bytes(&in, to->build_id, 20);
    get_bytes(&in, to->target, 24);
    to->tick_rate_Hz = get_u32(&in);
    to->baud = get_u32(&in);
    to->axis_count = get_u8(&in);
    to->state = get_u8(&in);
    to->reset_cause = get_u8(&in);
    to->model_flags = get_u8(&in);
    to->model_crc = get_u32(&in);
    to->max_payload = get_u16(&in);
    return true;
}

int32_t wire_pack_status_reply(const struct wire_status_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_STATUS_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u8(out, from->state);
    out = put_u8(out, from->fault);
    out = put_u8(out, from->fault_axis);
    out = put_u8(out, from->running_axes);
    out = put_u64(out, from->fault_tick);
    out = put_bytes(out, from->modes, 3);
    out = put_u8(out, from->at_rest);
    for (size_t i = 0; i < 3; i++)
        out = put_u16(out, from->adc_codes[i]);
    for (size_t i = 0; i < 3; i++)
        out = put_u16(out, from->dac_codes[i]);
    for (size_t i = 0; i < 3; i++)
        out = put_u32(out, from->saturations[i]);
    out = put_u32(out, from->overruns);
    out = put_u32(out, from->stream_dropped);
    out = put_u32(out, from->rx_errors);
    out = put_u32(out, from->model_crc);
    put_u64(out, from->first_tick);
    return WIRE_STATUS_REPLY_SIZE;
}

bool wire_unpack_status_reply(struct wire_status_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_STATUS_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->state = get_u8(&in);
    to->fault = get_u8(&in);
    to->fault_axis = get_u8(&in);
    to->running_axes = get_u8(&in);
    to->fault_tick = get_u64(&in);
    get_bytes(&in, to->modes, 3);
    to->at_rest = get_u8(&in);
    for (size_t i = 0; i < 3; i++)
        to->adc_codes[i] = get_u16(&in);
    for (size_t i = 0; i < 3; i++)
        to->dac_codes[i] = get_u16(&in);
    for (size_t i = 0; i < 3; i++)
        to->saturations[i] = get_u32(&in);
    to->overruns = get_u32(&in);
    to->stream_dropped = get_u32(&in);
    to->rx_errors = get_u32(&in);
    to->model_crc = get_u32(&in);
    to->first_tick = get_u64(&in);
    return true;
}

int32_t wire_pack_arm_request(const struct wire_arm_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_ARM_REQUEST_SIZE)
        return -1;
    put_u32(out, from->model_crc);
    return WIRE_ARM_REQUEST_SIZE;
}

bool wire_unpack_arm_request(struct wire_arm_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_ARM_REQUEST_SIZE)
        return false;
    to->model_crc = get_u32(&in);
    return true;
}

int32_t wire_pack_start_request(const struct wire_start_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_START_REQUEST_SIZE)
        return -1;
    put_u8(out, from->axis_mask);
    return WIRE_START_REQUEST_SIZE;
}

bool wire_unpack_start_request(struct wire_start_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_START_REQUEST_SIZE)
        return false;
    to->axis_mask = get_u8(&in);
    return true;
}

int32_t wire_pack_start_reply(const struct wire_start_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_START_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    put_u64(out, from->first_tick);
    return WIRE_START_REPLY_SIZE;
}

bool wire_unpack_start_reply(struct wire_start_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_START_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->first_tick = get_u64(&in);
    return true;
}

int32_t wire_pack_set_axis_request(const struct wire_set_axis_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_SET_AXIS_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->axis);
    out = put_u8(out, from->mode);
    out = put_u32(out, (uint32_t)from->kp_q24);
    out = put_u32(out, (uint32_t)from->ki_ts_q32);
    out = put_u32(out, (uint32_t)from->kd_over_ts_q24);
    out = put_u32(out, (uint32_t)from->d_alpha_q31);
    for (size_t i = 0; i < 2; i++) {
        wire_pack_biquad(&from->filters[i], out, WIRE_BIQUAD_SIZE);
        out += WIRE_BIQUAD_SIZE;
    }
    return WIRE_SET_AXIS_REQUEST_SIZE;
}

bool wire_unpack_set_axis_request(struct wire_set_axis_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_SET_AXIS_REQUEST_SIZE)
        return false;
    to->axis = get_u8(&in);
    to->mode = get_u8(&in);
    to->kp_q24 = (int32_t)get_u32(&in);
    to->ki_ts_q32 = (int32_t)get_u32(&in);
    to->kd_over_ts_q24 = (int32_t)get_u32(&in);
    to->d_alpha_q31 = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 2; i++) {
        wire_unpack_biquad(&to->filters[i], in, WIRE_BIQUAD_SIZE);
        in += WIRE_BIQUAD_SIZE;
    }
    return true;
}

int32_t wire_pack_set_path_request(const struct wire_set_path_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_SET_PATH_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->axis);
    out = put_u8(out, from->path);
    out = put_u32(out, (uint32_t)from->swing);
    out = put_u32(out, (uint32_t)from->offset);
    out = put_u64(out, from->step_turn64);
    put_u64(out, from->ticks);
    return WIRE_SET_PATH_REQUEST_SIZE;
}

bool wire_unpack_set_path_request(struct wire_set_path_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_SET_PATH_REQUEST_SIZE)
        return false;
    to->axis = get_u8(&in);
    to->path = get_u8(&in);
    to->swing = (int32_t)get_u32(&in);
    to->offset = (int32_t)get_u32(&in);
    to->step_turn64 = get_u64(&in);
    to->ticks = get_u64(&in);
    return true;
}

int32_t wire_pack_set_path_reply(const struct wire_set_path_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_SET_PATH_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u32(out, (uint32_t)from->inverse_gain_q28);
    put_u32(out, (uint32_t)from->lead_turn32);
    return WIRE_SET_PATH_REPLY_SIZE;
}

bool wire_unpack_set_path_reply(struct wire_set_path_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_SET_PATH_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->inverse_gain_q28 = (int32_t)get_u32(&in);
    to->lead_turn32 = (int32_t)get_u32(&in);
    return true;
}

int32_t wire_pack_wave_chunk_request(const struct wire_wave_chunk_request *from, uint8_t *out, size_t capacity)
{
    if (from->data_size > WIRE_MAX_PAYLOAD - WIRE_WAVE_CHUNK_REQUEST_SIZE ||
        capacity < WIRE_WAVE_CHUNK_REQUEST_SIZE + from->data_size)
        return -1;
    out = put_u8(out, from->axis);
    out = put_u16(out, from->offset);
    put_bytes(out, from->data, from->data_size);
    return (int32_t)(WIRE_WAVE_CHUNK_REQUEST_SIZE + from->data_size);
}

bool wire_unpack_wave_chunk_request(struct wire_wave_chunk_request *to, const uint8_t *in, size_t size)
{
    if (size < WIRE_WAVE_CHUNK_REQUEST_SIZE || size > WIRE_MAX_PAYLOAD)
        return false;
    to->axis = get_u8(&in);
    to->offset = get_u16(&in);
    to->data = in;
    to->data_size = size - WIRE_WAVE_CHUNK_REQUEST_SIZE;
    return true;
}

int32_t wire_pack_wave_commit_request(const struct wire_wave_commit_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_WAVE_COMMIT_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->axis);
    out = put_u32(out, from->crc);
    out = put_u32(out, from->model_crc);
    put_u32(out, from->path_crc);
    return WIRE_WAVE_COMMIT_REQUEST_SIZE;
}

bool wire_unpack_wave_commit_request(struct wire_wave_commit_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_WAVE_COMMIT_REQUEST_SIZE)
        return false;
    to->axis = get_u8(&in);
    to->crc = get_u32(&in);
    to->model_crc = get_u32(&in);
    to->path_crc = get_u32(&in);
    return true;
}

int32_t wire_pack_model_begin_request(const struct wire_model_begin_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_MODEL_BEGIN_REQUEST_SIZE)
        return -1;
    out = put_u32(out, from->size);
    put_u32(out, from->crc);
    return WIRE_MODEL_BEGIN_REQUEST_SIZE;
}

bool wire_unpack_model_begin_request(struct wire_model_begin_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_MODEL_BEGIN_REQUEST_SIZE)
        return false;
    to->size = get_u32(&in);
    to->crc = get_u32(&in);
    return true;
}

int32_t wire_pack_model_chunk_request(const struct wire_model_chunk_request *from, uint8_t *out, size_t capacity)
{
    if (from->data_size > WIRE_MAX_PAYLOAD - WIRE_MODEL_CHUNK_REQUEST_SIZE ||
        capacity < WIRE_MODEL_CHUNK_REQUEST_SIZE + from->data_size)
        return -1;
    out = put_u32(out, from->offset);
    put_bytes(out, from->data, from->data_size);
    return (int32_t)(WIRE_MODEL_CHUNK_REQUEST_SIZE + from->data_size);
}

bool wire_unpack_model_chunk_request(struct wire_model_chunk_request *to, const uint8_t *in, size_t size)
{
    if (size < WIRE_MODEL_CHUNK_REQUEST_SIZE || size > WIRE_MAX_PAYLOAD)
        return false;
    to->offset = get_u32(&in);
    to->data = in;
    to->data_size = size - WIRE_MODEL_CHUNK_REQUEST_SIZE;
    return true;
}

int32_t wire_pack_model_commit_reply(const struct wire_model_commit_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_MODEL_COMMIT_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u16(out, from->invalid_field);
    put_u8(out, from->held_back);
    return WIRE_MODEL_COMMIT_REPLY_SIZE;
}

bool wire_unpack_model_commit_reply(struct wire_model_commit_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_MODEL_COMMIT_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->invalid_field = get_u16(&in);
    to->held_back = get_u8(&in);
    return true;
}

int32_t wire_pack_model_read_request(const struct wire_model_read_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_MODEL_READ_REQUEST_SIZE)
        return -1;
    out = put_u32(out, from->offset);
    put_u16(out, from->length);
    return WIRE_MODEL_READ_REQUEST_SIZE;
}

bool wire_unpack_model_read_request(struct wire_model_read_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_MODEL_READ_REQUEST_SIZE)
        return false;
    to->offset = get_u32(&in);
    to->length = get_u16(&in);
    return true;
}

int32_t wire_pack_model_read_reply(const struct wire_model_read_reply *from, uint8_t *out, size_t capacity)
{
    if (from->data_size > WIRE_MAX_PAYLOAD - WIRE_MODEL_READ_REPLY_SIZE ||
        capacity < WIRE_MODEL_READ_REPLY_SIZE + from->data_size)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u32(out, from->size);
    out = put_u32(out, from->crc);
    put_bytes(out, from->data, from->data_size);
    return (int32_t)(WIRE_MODEL_READ_REPLY_SIZE + from->data_size);
}

bool wire_unpack_model_read_reply(struct wire_model_read_reply *to, const uint8_t *in, size_t size)
{
    if (size < WIRE_MODEL_READ_REPLY_SIZE || size > WIRE_MAX_PAYLOAD)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->size = get_u32(&in);
    to->crc = get_u32(&in);
    to->data = in;
    to->data_size = size - WIRE_MODEL_READ_REPLY_SIZE;
    return true;
}

int32_t wire_pack_model_persist_reply(const struct wire_model_persist_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_MODEL_PERSIST_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    put_u32(out, from->sequence);
    return WIRE_MODEL_PERSIST_REPLY_SIZE;
}

bool wire_unpack_model_persist_reply(struct wire_model_persist_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_MODEL_PERSIST_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->sequence = get_u32(&in);
    return true;
}

int32_t wire_pack_stream_start_request(const struct wire_stream_start_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_STREAM_START_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->channels);
    out = put_u8(out, from->axis_mask);
    put_u16(out, from->decimation);
    return WIRE_STREAM_START_REQUEST_SIZE;
}

bool wire_unpack_stream_start_request(struct wire_stream_start_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_STREAM_START_REQUEST_SIZE)
        return false;
    to->channels = get_u8(&in);
    to->axis_mask = get_u8(&in);
    to->decimation = get_u16(&in);
    return true;
}

int32_t wire_pack_stream_start_reply(const struct wire_stream_start_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_STREAM_START_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u32(out, from->bytes_per_s);
    out = put_u32(out, from->budget_bytes_per_s);
    put_u32(out, from->state_size);
    return WIRE_STREAM_START_REPLY_SIZE;
}

bool wire_unpack_stream_start_reply(struct wire_stream_start_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_STREAM_START_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->bytes_per_s = get_u32(&in);
    to->budget_bytes_per_s = get_u32(&in);
    to->state_size = get_u32(&in);
    return true;
}

int32_t wire_pack_stream_stop_reply(const struct wire_stream_stop_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_STREAM_STOP_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u64(out, from->sent_ticks);
    put_u64(out, from->dropped_ticks);
    return WIRE_STREAM_STOP_REPLY_SIZE;
}

bool wire_unpack_stream_stop_reply(struct wire_stream_stop_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_STREAM_STOP_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->sent_ticks = get_u64(&in);
    to->dropped_ticks = get_u64(&in);
    return true;
}

int32_t wire_pack_snapshot_read_request(const struct wire_snapshot_read_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_SNAPSHOT_READ_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->region);
    out = put_u32(out, from->offset);
    put_u16(out, from->length);
    return WIRE_SNAPSHOT_READ_REQUEST_SIZE;
}

bool wire_unpack_snapshot_read_request(struct wire_snapshot_read_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_SNAPSHOT_READ_REQUEST_SIZE)
        return false;
    to->region = get_u8(&in);
    to->offset = get_u32(&in);
    to->length = get_u16(&in);
    return true;
}

int32_t wire_pack_snapshot_read_reply(const struct wire_snapshot_read_reply *from, uint8_t *out, size_t capacity)
{
    if (from->data_size > WIRE_MAX_PAYLOAD - WIRE_SNAPSHOT_READ_REPLY_SIZE ||
        capacity < WIRE_SNAPSHOT_READ_REPLY_SIZE + from->data_size)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u32(out, from->size);
    put_bytes(out, from->data, from->data_size);
    return (int32_t)(WIRE_SNAPSHOT_READ_REPLY_SIZE + from->data_size);
}

bool wire_unpack_snapshot_read_reply(struct wire_snapshot_read_reply *to, const uint8_t *in, size_t size)
{
    if (size < WIRE_SNAPSHOT_READ_REPLY_SIZE || size > WIRE_MAX_PAYLOAD)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->size = get_u32(&in);
    to->data = in;
    to->data_size = size - WIRE_SNAPSHOT_READ_REPLY_SIZE;
    return true;
}

int32_t wire_pack_set_timeout_request(const struct wire_set_timeout_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_SET_TIMEOUT_REQUEST_SIZE)
        return -1;
    put_u32(out, from->ticks);
    return WIRE_SET_TIMEOUT_REQUEST_SIZE;
}

bool wire_unpack_set_timeout_request(struct wire_set_timeout_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_SET_TIMEOUT_REQUEST_SIZE)
        return false;
    to->ticks = get_u32(&in);
    return true;
}

int32_t wire_pack_info_reply(const struct wire_info_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_INFO_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u32(out, from->cycles_last);
    out = put_u32(out, from->cycles_max);
    for (size_t i = 0; i < 16; i++)
        out = put_u32(out, from->histogram[i]);
    out = put_u32(out, from->overruns);
    out = put_u32(out, from->latched_late);
    out = put_u32(out, from->lost_ticks);
    out = put_u8(out, from->brown_out_level);
    out = put_u8(out, from->last_fault);
    out = put_u32(out, from->last_fault_detail);
    out = put_u32(out, from->flash_sequence);
    out = put_u8(out, from->model_flags);
    put_u32(out, from->model_crc);
    return WIRE_INFO_REPLY_SIZE;
}

bool wire_unpack_info_reply(struct wire_info_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_INFO_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->cycles_last = get_u32(&in);
    to->cycles_max = get_u32(&in);
    for (size_t i = 0; i < 16; i++)
        to->histogram[i] = get_u32(&in);
    to->overruns = get_u32(&in);
    to->latched_late = get_u32(&in);
    to->lost_ticks = get_u32(&in);
    to->brown_out_level = get_u8(&in);
    to->last_fault = get_u8(&in);
    to->last_fault_detail = get_u32(&in);
    to->flash_sequence = get_u32(&in);
    to->model_flags = get_u8(&in);
    to->model_crc = get_u32(&in);
    return true;
}

int32_t wire_pack_motion_request(const struct wire_motion_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_MOTION_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->axis);
    out = put_u64(out, from->velocity);
    out = put_u64(out, from->acceleration);
    out = put_u64(out, from->jerk);
    out = put_u32(out, (uint32_t)from->window_q16);
    put_u32(out, from->window_ticks);
    return WIRE_MOTION_REQUEST_SIZE;
}

bool wire_unpack_motion_request(struct wire_motion_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_MOTION_REQUEST_SIZE)
        return false;
    to->axis = get_u8(&in);
    to->velocity = get_u64(&in);
    to->acceleration = get_u64(&in);
    to->jerk = get_u64(&in);
    to->window_q16 = (int32_t)get_u32(&in);
    to->window_ticks = get_u32(&in);
    return true;
}

int32_t wire_pack_queue_request(const struct wire_queue_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_QUEUE_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->axis_mask);
    out = put_u8(out, from->at_once);
    out = put_u64(out, from->begin_tick);
    for (size_t i = 0; i < 3; i++) {
        wire_pack_segment(&from->segments[i], out, WIRE_SEGMENT_SIZE);
        out += WIRE_SEGMENT_SIZE;
    }
    put_u8(out, from->at_trigger);
    return WIRE_QUEUE_REQUEST_SIZE;
}

bool wire_unpack_queue_request(struct wire_queue_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_QUEUE_REQUEST_SIZE)
        return false;
    to->axis_mask = get_u8(&in);
    to->at_once = get_u8(&in);
    to->begin_tick = get_u64(&in);
    for (size_t i = 0; i < 3; i++) {
        wire_unpack_segment(&to->segments[i], in, WIRE_SEGMENT_SIZE);
        in += WIRE_SEGMENT_SIZE;
    }
    to->at_trigger = get_u8(&in);
    return true;
}

int32_t wire_pack_queue_reply(const struct wire_queue_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_QUEUE_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    put_bytes(out, from->queued, 3);
    return WIRE_QUEUE_REPLY_SIZE;
}

bool wire_unpack_queue_reply(struct wire_queue_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_QUEUE_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    get_bytes(&in, to->queued, 3);
    return true;
}

int32_t wire_pack_set_joins_request(const struct wire_set_joins_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_SET_JOINS_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->axis);
    out = put_u8(out, from->flags);
    out = put_u16(out, from->enter_ticks);
    put_u16(out, from->leave_ticks);
    return WIRE_SET_JOINS_REQUEST_SIZE;
}

bool wire_unpack_set_joins_request(struct wire_set_joins_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_SET_JOINS_REQUEST_SIZE)
        return false;
    to->axis = get_u8(&in);
    to->flags = get_u8(&in);
    to->enter_ticks = get_u16(&in);
    to->leave_ticks = get_u16(&in);
    return true;
}

int32_t wire_pack_points_begin_request(const struct wire_points_begin_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_POINTS_BEGIN_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->axis_mask);
    out = put_u8(out, from->ticks_log2);
    out = put_u32(out, (uint32_t)from->first);
    for (size_t i = 0; i < 3; i++)
        out = put_u32(out, from->steepest_q30[i]);
    return WIRE_POINTS_BEGIN_REQUEST_SIZE;
}

bool wire_unpack_points_begin_request(struct wire_points_begin_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_POINTS_BEGIN_REQUEST_SIZE)
        return false;
    to->axis_mask = get_u8(&in);
    to->ticks_log2 = get_u8(&in);
    to->first = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 3; i++)
        to->steepest_q30[i] = get_u32(&in);
    return true;
}

int32_t wire_pack_points_request(const struct wire_points_request *from, uint8_t *out, size_t capacity)
{
    if (from->data_size > WIRE_MAX_PAYLOAD - WIRE_POINTS_REQUEST_SIZE ||
        capacity < WIRE_POINTS_REQUEST_SIZE + from->data_size)
        return -1;
    out = put_u8(out, from->axis_mask);
    out = put_u32(out, (uint32_t)from->first);
    out = put_u64(out, from->length_ticks);
    put_bytes(out, from->data, from->data_size);
    return (int32_t)(WIRE_POINTS_REQUEST_SIZE + from->data_size);
}

bool wire_unpack_points_request(struct wire_points_request *to, const uint8_t *in, size_t size)
{
    if (size < WIRE_POINTS_REQUEST_SIZE || size > WIRE_MAX_PAYLOAD)
        return false;
    to->axis_mask = get_u8(&in);
    to->first = (int32_t)get_u32(&in);
    to->length_ticks = get_u64(&in);
    to->data = in;
    to->data_size = size - WIRE_POINTS_REQUEST_SIZE;
    return true;
}

int32_t wire_pack_points_reply(const struct wire_points_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_POINTS_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u16(out, from->room);
    put_u32(out, from->left_ticks);
    return WIRE_POINTS_REPLY_SIZE;
}

bool wire_unpack_points_reply(struct wire_points_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_POINTS_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->room = get_u16(&in);
    to->left_ticks = get_u32(&in);
    return true;
}

int32_t wire_pack_trigger_set_request(const struct wire_trigger_set_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_TRIGGER_SET_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->output);
    out = put_u8(out, from->mark);
    out = put_u8(out, from->axis);
    out = put_u8(out, from->rising);
    out = put_u32(out, from->every);
    put_u32(out, (uint32_t)from->origin);
    return WIRE_TRIGGER_SET_REQUEST_SIZE;
}

bool wire_unpack_trigger_set_request(struct wire_trigger_set_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_TRIGGER_SET_REQUEST_SIZE)
        return false;
    to->output = get_u8(&in);
    to->mark = get_u8(&in);
    to->axis = get_u8(&in);
    to->rising = get_u8(&in);
    to->every = get_u32(&in);
    to->origin = (int32_t)get_u32(&in);
    return true;
}

int32_t wire_pack_set_gains_request(const struct wire_set_gains_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_SET_GAINS_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->axis);
    out = put_u32(out, (uint32_t)from->kp_q24);
    out = put_u32(out, (uint32_t)from->ki_ts_q32);
    out = put_u32(out, (uint32_t)from->kd_over_ts_q24);
    out = put_u32(out, (uint32_t)from->d_alpha_q31);
    for (size_t i = 0; i < 2; i++) {
        wire_pack_biquad(&from->filters[i], out, WIRE_BIQUAD_SIZE);
        out += WIRE_BIQUAD_SIZE;
    }
    return WIRE_SET_GAINS_REQUEST_SIZE;
}

bool wire_unpack_set_gains_request(struct wire_set_gains_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_SET_GAINS_REQUEST_SIZE)
        return false;
    to->axis = get_u8(&in);
    to->kp_q24 = (int32_t)get_u32(&in);
    to->ki_ts_q32 = (int32_t)get_u32(&in);
    to->kd_over_ts_q24 = (int32_t)get_u32(&in);
    to->d_alpha_q31 = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 2; i++) {
        wire_unpack_biquad(&to->filters[i], in, WIRE_BIQUAD_SIZE);
        in += WIRE_BIQUAD_SIZE;
    }
    return true;
}

int32_t wire_pack_where_reply(const struct wire_where_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_WHERE_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u8(out, from->state);
    out = put_u8(out, from->fault);
    out = put_u8(out, from->driven);
    out = put_u8(out, from->moving);
    out = put_u8(out, from->on_target);
    out = put_u8(out, from->dry);
    out = put_bytes(out, from->queued, 3);
    for (size_t i = 0; i < 3; i++)
        out = put_u16(out, from->adc_codes[i]);
    for (size_t i = 0; i < 3; i++)
        out = put_u32(out, (uint32_t)from->u_q24[i]);
    for (size_t i = 0; i < 3; i++)
        out = put_u32(out, (uint32_t)from->reference[i]);
    for (size_t i = 0; i < 3; i++)
        out = put_u32(out, (uint32_t)from->end[i]);
    for (size_t i = 0; i < 3; i++)
        out = put_u32(out, from->near_ticks[i]);
    for (size_t i = 0; i < 3; i++)
        out = put_u64(out, from->dry_ticks[i]);
    return WIRE_WHERE_REPLY_SIZE;
}

bool wire_unpack_where_reply(struct wire_where_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_WHERE_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->state = get_u8(&in);
    to->fault = get_u8(&in);
    to->driven = get_u8(&in);
    to->moving = get_u8(&in);
    to->on_target = get_u8(&in);
    to->dry = get_u8(&in);
    get_bytes(&in, to->queued, 3);
    for (size_t i = 0; i < 3; i++)
        to->adc_codes[i] = get_u16(&in);
    for (size_t i = 0; i < 3; i++)
        to->u_q24[i] = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 3; i++)
        to->reference[i] = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 3; i++)
        to->end[i] = (int32_t)get_u32(&in);
    for (size_t i = 0; i < 3; i++)
        to->near_ticks[i] = get_u32(&in);
    for (size_t i = 0; i < 3; i++)
        to->dry_ticks[i] = get_u64(&in);
    return true;
}

int32_t wire_pack_update_info_reply(const struct wire_update_info_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_UPDATE_INFO_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u8(out, from->slot);
    out = put_u8(out, from->standing);
    out = put_u8(out, from->attempts);
    out = put_u32(out, from->slot_size);
    out = put_u32(out, from->free_address);
    out = put_u32(out, from->version);
    put_u32(out, from->trial_ticks);
    return WIRE_UPDATE_INFO_REPLY_SIZE;
}

bool wire_unpack_update_info_reply(struct wire_update_info_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_UPDATE_INFO_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->slot = get_u8(&in);
    to->standing = get_u8(&in);
    to->attempts = get_u8(&in);
    to->slot_size = get_u32(&in);
    to->free_address = get_u32(&in);
    to->version = get_u32(&in);
    to->trial_ticks = get_u32(&in);
    return true;
}

int32_t wire_pack_update_begin_request(const struct wire_update_begin_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_UPDATE_BEGIN_REQUEST_SIZE)
        return -1;
    put_bytes(out, from->header, 64);
    return WIRE_UPDATE_BEGIN_REQUEST_SIZE;
}

bool wire_unpack_update_begin_request(struct wire_update_begin_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_UPDATE_BEGIN_REQUEST_SIZE)
        return false;
    get_bytes(&in, to->header, 64);
    return true;
}

int32_t wire_pack_update_chunk_request(const struct wire_update_chunk_request *from, uint8_t *out, size_t capacity)
{
    if (from->data_size > WIRE_MAX_PAYLOAD - WIRE_UPDATE_CHUNK_REQUEST_SIZE ||
        capacity < WIRE_UPDATE_CHUNK_REQUEST_SIZE + from->data_size)
        return -1;
    out = put_u32(out, from->offset);
    put_bytes(out, from->data, from->data_size);
    return (int32_t)(WIRE_UPDATE_CHUNK_REQUEST_SIZE + from->data_size);
}

bool wire_unpack_update_chunk_request(struct wire_update_chunk_request *to, const uint8_t *in, size_t size)
{
    if (size < WIRE_UPDATE_CHUNK_REQUEST_SIZE || size > WIRE_MAX_PAYLOAD)
        return false;
    to->offset = get_u32(&in);
    to->data = in;
    to->data_size = size - WIRE_UPDATE_CHUNK_REQUEST_SIZE;
    return true;
}

int32_t wire_pack_update_confirm_request(const struct wire_update_confirm_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_UPDATE_CONFIRM_REQUEST_SIZE)
        return -1;
    put_bytes(out, from->build_id, 20);
    return WIRE_UPDATE_CONFIRM_REQUEST_SIZE;
}

bool wire_unpack_update_confirm_request(struct wire_update_confirm_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_UPDATE_CONFIRM_REQUEST_SIZE)
        return false;
    get_bytes(&in, to->build_id, 20);
    return true;
}

int32_t wire_pack_limits_set_request(const struct wire_limits_set_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_LIMITS_SET_REQUEST_SIZE)
        return -1;
    for (size_t i = 0; i < 3; i++) {
        wire_pack_axis_limits(&from->limits[i], out, WIRE_AXIS_LIMITS_SIZE);
        out += WIRE_AXIS_LIMITS_SIZE;
    }
    return WIRE_LIMITS_SET_REQUEST_SIZE;
}

bool wire_unpack_limits_set_request(struct wire_limits_set_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_LIMITS_SET_REQUEST_SIZE)
        return false;
    for (size_t i = 0; i < 3; i++) {
        wire_unpack_axis_limits(&to->limits[i], in, WIRE_AXIS_LIMITS_SIZE);
        in += WIRE_AXIS_LIMITS_SIZE;
    }
    return true;
}

int32_t wire_pack_limits_read_reply(const struct wire_limits_read_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_LIMITS_READ_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u8(out, from->limits_lost);
    for (size_t i = 0; i < 3; i++) {
        wire_pack_axis_limits(&from->limits[i], out, WIRE_AXIS_LIMITS_SIZE);
        out += WIRE_AXIS_LIMITS_SIZE;
    }
    return WIRE_LIMITS_READ_REPLY_SIZE;
}

bool wire_unpack_limits_read_reply(struct wire_limits_read_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_LIMITS_READ_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->limits_lost = get_u8(&in);
    for (size_t i = 0; i < 3; i++) {
        wire_unpack_axis_limits(&to->limits[i], in, WIRE_AXIS_LIMITS_SIZE);
        in += WIRE_AXIS_LIMITS_SIZE;
    }
    return true;
}

int32_t wire_pack_fault_log_reply(const struct wire_fault_log_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_FAULT_LOG_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u32(out, from->power_cycle);
    out = put_u8(out, from->count);
    for (size_t i = 0; i < 16; i++) {
        wire_pack_logged_fault(&from->faults[i], out, WIRE_LOGGED_FAULT_SIZE);
        out += WIRE_LOGGED_FAULT_SIZE;
    }
    return WIRE_FAULT_LOG_REPLY_SIZE;
}

bool wire_unpack_fault_log_reply(struct wire_fault_log_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_FAULT_LOG_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->power_cycle = get_u32(&in);
    to->count = get_u8(&in);
    for (size_t i = 0; i < 16; i++) {
        wire_unpack_logged_fault(&to->faults[i], in, WIRE_LOGGED_FAULT_SIZE);
        in += WIRE_LOGGED_FAULT_SIZE;
    }
    return true;
}

int32_t wire_pack_transient_arm_request(const struct wire_transient_arm_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_TRANSIENT_ARM_REQUEST_SIZE)
        return -1;
    out = put_u8(out, from->trigger);
    out = put_u8(out, from->axis);
    out = put_u8(out, from->channel);
    out = put_u8(out, from->falling);
    out = put_u32(out, (uint32_t)from->level);
    out = put_u16(out, from->decimation);
    put_u16(out, from->after);
    return WIRE_TRANSIENT_ARM_REQUEST_SIZE;
}

bool wire_unpack_transient_arm_request(struct wire_transient_arm_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_TRANSIENT_ARM_REQUEST_SIZE)
        return false;
    to->trigger = get_u8(&in);
    to->axis = get_u8(&in);
    to->channel = get_u8(&in);
    to->falling = get_u8(&in);
    to->level = (int32_t)get_u32(&in);
    to->decimation = get_u16(&in);
    to->after = get_u16(&in);
    return true;
}

int32_t wire_pack_transient_arm_reply(const struct wire_transient_arm_reply *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_TRANSIENT_ARM_REPLY_SIZE)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    put_u16(out, from->entries);
    return WIRE_TRANSIENT_ARM_REPLY_SIZE;
}

bool wire_unpack_transient_arm_reply(struct wire_transient_arm_reply *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_TRANSIENT_ARM_REPLY_SIZE)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->entries = get_u16(&in);
    return true;
}

int32_t wire_pack_transient_read_request(const struct wire_transient_read_request *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_TRANSIENT_READ_REQUEST_SIZE)
        return -1;
    out = put_u32(out, from->offset);
    put_u16(out, from->length);
    return WIRE_TRANSIENT_READ_REQUEST_SIZE;
}

bool wire_unpack_transient_read_request(struct wire_transient_read_request *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_TRANSIENT_READ_REQUEST_SIZE)
        return false;
    to->offset = get_u32(&in);
    to->length = get_u16(&in);
    return true;
}

int32_t wire_pack_transient_read_reply(const struct wire_transient_read_reply *from, uint8_t *out, size_t capacity)
{
    if (from->data_size > WIRE_MAX_PAYLOAD - WIRE_TRANSIENT_READ_REPLY_SIZE ||
        capacity < WIRE_TRANSIENT_READ_REPLY_SIZE + from->data_size)
        return -1;
    out = put_u8(out, from->status);
    out = put_u64(out, from->tick);
    out = put_u8(out, from->state);
    out = put_u8(out, from->cause);
    out = put_u64(out, from->trigger_tick);
    out = put_u16(out, from->decimation);
    out = put_bytes(out, from->modes, 3);
    out = put_u32(out, from->size);
    put_bytes(out, from->data, from->data_size);
    return (int32_t)(WIRE_TRANSIENT_READ_REPLY_SIZE + from->data_size);
}

bool wire_unpack_transient_read_reply(struct wire_transient_read_reply *to, const uint8_t *in, size_t size)
{
    if (size < WIRE_TRANSIENT_READ_REPLY_SIZE || size > WIRE_MAX_PAYLOAD)
        return false;
    to->status = get_u8(&in);
    to->tick = get_u64(&in);
    to->state = get_u8(&in);
    to->cause = get_u8(&in);
    to->trigger_tick = get_u64(&in);
    to->decimation = get_u16(&in);
    get_bytes(&in, to->modes, 3);
    to->size = get_u32(&in);
    to->data = in;
    to->data_size = size - WIRE_TRANSIENT_READ_REPLY_SIZE;
    return true;
}

int32_t wire_pack_samples(const struct wire_samples *from, uint8_t *out, size_t capacity)
{
    if (from->data_size > WIRE_MAX_PAYLOAD - WIRE_SAMPLES_SIZE ||
        capacity < WIRE_SAMPLES_SIZE + from->data_size)
        return -1;
    out = put_u32(out, from->sequence);
    out = put_u64(out, from->first_tick);
    out = put_u32(out, from->dropped);
    out = put_u8(out, from->channels);
    out = put_u8(out, from->axis_mask);
    out = put_u16(out, from->decimation);
    put_bytes(out, from->data, from->data_size);
    return (int32_t)(WIRE_SAMPLES_SIZE + from->data_size);
}

bool wire_unpack_samples(struct wire_samples *to, const uint8_t *in, size_t size)
{
    if (size < WIRE_SAMPLES_SIZE || size > WIRE_MAX_PAYLOAD)
        return false;
    to->sequence = get_u32(&in);
    to->first_tick = get_u64(&in);
    to->dropped = get_u32(&in);
    to->channels = get_u8(&in);
    to->axis_mask = get_u8(&in);
    to->decimation = get_u16(&in);
    to->data = in;
    to->data_size = size - WIRE_SAMPLES_SIZE;
    return true;
}

int32_t wire_pack_event(const struct wire_event *from, uint8_t *out, size_t capacity)
{
    if (capacity < WIRE_EVENT_SIZE)
        return -1;
    out = put_u64(out, from->tick);
    out = put_u8(out, from->kind);
    put_u32(out, from->value);
    return WIRE_EVENT_SIZE;
}

bool wire_unpack_event(struct wire_event *to, const uint8_t *in, size_t size)
{
    if (size != WIRE_EVENT_SIZE)
        return false;
    to->tick = get_u64(&in);
    to->kind = get_u8(&in);
    to->value = get_u32(&in);
    return true;
}
