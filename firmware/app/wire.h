/* generated from protocol/schema.toml by protocol/generate.py */
/* clang-format off */

#ifndef PHASELEAD_APP_WIRE_H
#define PHASELEAD_APP_WIRE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Sizes in bytes; *_SIZE of a message or record is that of its fixed part on the line. */
#define WIRE_FINGERPRINT 0xD1C20CFCu
#define WIRE_VERSION 2
#define WIRE_REVISION 5
#define WIRE_MAX_PAYLOAD 1152
#define WIRE_HEADER_SIZE 11
#define WIRE_CRC_SIZE 4
#define WIRE_MAX_BODY (WIRE_HEADER_SIZE + WIRE_MAX_PAYLOAD + WIRE_CRC_SIZE)
#define WIRE_REPLY_BIT 0x80

enum wire_type {
    WIRE_HELLO = 0x01,
    WIRE_STOP = 0x02,
    WIRE_STATUS = 0x03,
    WIRE_ARM = 0x04,
    WIRE_START = 0x05,
    WIRE_PARK = 0x06,
    WIRE_CLEAR_FAULT = 0x07,
    WIRE_SET_AXIS = 0x08,
    WIRE_SET_PATH = 0x09,
    WIRE_WAVE_CHUNK = 0x0A,
    WIRE_WAVE_COMMIT = 0x0B,
    WIRE_MODEL_BEGIN = 0x0C,
    WIRE_MODEL_CHUNK = 0x0D,
    WIRE_MODEL_COMMIT = 0x0E,
    WIRE_MODEL_READ = 0x0F,
    WIRE_MODEL_PERSIST = 0x10,
    WIRE_STREAM_START = 0x11,
    WIRE_STREAM_STOP = 0x12,
    WIRE_SNAPSHOT_READ = 0x13,
    WIRE_SET_TIMEOUT = 0x14,
    WIRE_INFO = 0x15,
    WIRE_MOTION = 0x40,
    WIRE_QUEUE = 0x41,
    WIRE_SET_JOINS = 0x44,
    WIRE_POINTS_BEGIN = 0x45,
    WIRE_POINTS = 0x46,
    WIRE_TRIGGER_SET = 0x47,
    WIRE_SET_GAINS = 0x42,
    WIRE_WHERE = 0x43,
    WIRE_UPDATE_INFO = 0x30,
    WIRE_UPDATE_BEGIN = 0x31,
    WIRE_UPDATE_CHUNK = 0x32,
    WIRE_UPDATE_COMMIT = 0x33,
    WIRE_UPDATE_RESTART = 0x34,
    WIRE_UPDATE_CONFIRM = 0x35,
    WIRE_LIMITS_SET = 0x20,
    WIRE_LIMITS_READ = 0x21,
    WIRE_FAULT_LOG = 0x22,
    WIRE_TRANSIENT_ARM = 0x23,
    WIRE_TRANSIENT_READ = 0x24,
    WIRE_SAMPLES = 0x70,
    WIRE_EVENT = 0x71,
};

/* Supervisor state */
enum wire_state {
    WIRE_STATE_PARKED = 0,
    WIRE_STATE_ARMED = 1,
    WIRE_STATE_RUNNING = 2,
    WIRE_STATE_STOPPING = 3,
    WIRE_STATE_FAULT = 4,
};
#define WIRE_STATE_COUNT 5

/* What drives an axis */
enum wire_mode {
    WIRE_MODE_IDLE = 0,
    WIRE_MODE_OPEN = 1,
    WIRE_MODE_PID = 2,
    WIRE_MODE_FF = 3,
    WIRE_MODE_FF_PID = 4,
    WIRE_MODE_INVERSE = 5,
    WIRE_MODE_INVERSE_PID = 6,
};
#define WIRE_MODE_COUNT 7

/* Reference path of an axis; in mode open its values are volts (q24), else micrometres (q16) */
enum wire_path_kind {
    WIRE_PATH_KIND_HOLD = 0,
    WIRE_PATH_KIND_SINE = 1,
    WIRE_PATH_KIND_WAVE = 2,
    WIRE_PATH_KIND_MOVE = 3,
};
#define WIRE_PATH_KIND_COUNT 4

/* Bits of a path's flags */
enum wire_path_flag {
    WIRE_PATH_FLAG_FROM_HERE = 1,
    WIRE_PATH_FLAG_MORE = 2,
};
#define WIRE_PATH_FLAG_COUNT 2

/* First byte of every reply */
enum wire_status {
    WIRE_STATUS_OK = 0,
    WIRE_STATUS_NO_SESSION = 1,
    WIRE_STATUS_UNKNOWN_COMMAND = 2,
    WIRE_STATUS_BAD_LENGTH = 3,
    WIRE_STATUS_WRONG_STATE = 4,
    WIRE_STATUS_BAD_VALUE = 5,
    WIRE_STATUS_NO_MODEL = 6,
    WIRE_STATUS_MODEL_INVALID = 7,
    WIRE_STATUS_CRC_MISMATCH = 8,
    WIRE_STATUS_OUTSIDE_RECTANGLE = 9,
    WIRE_STATUS_OUTSIDE_LIMITS = 10,
    WIRE_STATUS_BAUD_BUDGET = 11,
    WIRE_STATUS_MUST_NAME_MODEL = 12,
    WIRE_STATUS_FLASH_FAILED = 13,
    WIRE_STATUS_FAULT_LATCHED = 14,
    WIRE_STATUS_BUSY = 15,
    WIRE_STATUS_MODE_UNSUPPORTED = 16,
    WIRE_STATUS_LIMITS_LOST = 17,
    WIRE_STATUS_LEARNED_FOR_OTHER = 18,
};
#define WIRE_STATUS_COUNT 19

/* Why the device stopped; each is described in docs/faults.md */
enum wire_fault {
    WIRE_FAULT_NONE = 0,
    WIRE_FAULT_HOST_TIMEOUT = 1,
    WIRE_FAULT_TICK_OVERRUN = 2,
    WIRE_FAULT_ADC_RAIL = 3,
    WIRE_FAULT_CONVERTER_SILENT = 4,
    WIRE_FAULT_INTERLOCK = 5,
    WIRE_FAULT_FLASH_ERROR = 6,
    WIRE_FAULT_CORE_LOST = 7,
    WIRE_FAULT_TRACKING_ERROR = 8,
    WIRE_FAULT_TICK_LOST = 9,
    WIRE_FAULT_SENSOR_FROZEN = 10,
    WIRE_FAULT_SENSOR_JUMP = 11,
    WIRE_FAULT_OUTPUT_LIMITED = 12,
    WIRE_FAULT_POSITION_LIMIT = 13,
    WIRE_FAULT_OSCILLATION = 14,
};
#define WIRE_FAULT_COUNT 15

/* Why the device last started */
enum wire_reset_cause {
    WIRE_RESET_CAUSE_POWER_ON = 0,
    WIRE_RESET_CAUSE_PIN = 1,
    WIRE_RESET_CAUSE_WATCHDOG = 2,
    WIRE_RESET_CAUSE_SOFTWARE = 3,
    WIRE_RESET_CAUSE_BROWN_OUT = 4,
};
#define WIRE_RESET_CAUSE_COUNT 5

/* Top four bits of a core_lost fault's detail: what ended the program; below them its address */
enum wire_core_loss {
    WIRE_CORE_LOSS_WATCHDOG = 0,
    WIRE_CORE_LOSS_HARD_FAULT = 1,
    WIRE_CORE_LOSS_MEMORY_FAULT = 2,
    WIRE_CORE_LOSS_BUS_FAULT = 3,
    WIRE_CORE_LOSS_USAGE_FAULT = 4,
    WIRE_CORE_LOSS_STACK_OVERFLOW = 5,
    WIRE_CORE_LOSS_CLOCK_STOPPED = 6,
    WIRE_CORE_LOSS_NO_CRYSTAL = 7,
    WIRE_CORE_LOSS_STRAY_INTERRUPT = 8,
    WIRE_CORE_LOSS_SUPPLY_LOW = 9,
};
#define WIRE_CORE_LOSS_COUNT 10

/* Bits of the stream's channel mask; per tick and axis, in this order */
enum wire_channel {
    WIRE_CHANNEL_REFERENCE = 1,
    WIRE_CHANNEL_ADC = 2,
    WIRE_CHANNEL_DAC = 4,
    WIRE_CHANNEL_FEEDFORWARD = 8,
    WIRE_CHANNEL_FEEDBACK = 16,
    WIRE_CHANNEL_TRIGGER = 32,
};
#define WIRE_CHANNEL_COUNT 6

/* What SNAPSHOT_READ reads */
enum wire_region {
    WIRE_REGION_STATE = 0,
    WIRE_REGION_WAVE_X = 1,
    WIRE_REGION_WAVE_Y = 2,
    WIRE_REGION_WAVE_Z = 3,
    WIRE_REGION_FAULTS = 4,
};
#define WIRE_REGION_COUNT 5

/* What an unsolicited event reports */
enum wire_event_kind {
    WIRE_EVENT_KIND_STATE_CHANGE = 0,
    WIRE_EVENT_KIND_FAULT = 1,
    WIRE_EVENT_KIND_STREAM_OVERFLOW = 2,
    WIRE_EVENT_KIND_PATH_DONE = 3,
    WIRE_EVENT_KIND_TRIGGER = 4,
};
#define WIRE_EVENT_KIND_COUNT 5

/* What is known of the firmware image that runs */
enum wire_update_standing {
    WIRE_UPDATE_STANDING_CONFIRMED = 0,
    WIRE_UPDATE_STANDING_TRIAL = 1,
    WIRE_UPDATE_STANDING_ROLLED_BACK = 2,
};
#define WIRE_UPDATE_STANDING_COUNT 3

/* What freezes the transient recorder; a fault always does */
enum wire_trigger {
    WIRE_TRIGGER_FAULT = 0,
    WIRE_TRIGGER_SET_POINT = 1,
    WIRE_TRIGGER_THRESHOLD = 2,
    WIRE_TRIGGER_INPUT = 3,
};
#define WIRE_TRIGGER_COUNT 4

/* Where on the path of an axis a trigger output pulses */
enum wire_mark {
    WIRE_MARK_NONE = 0,
    WIRE_MARK_TURN = 1,
    WIRE_MARK_TIME = 2,
    WIRE_MARK_WAY = 3,
    WIRE_MARK_TARGET = 4,
};
#define WIRE_MARK_COUNT 5

/* What the transient recorder does */
enum wire_transient_state {
    WIRE_TRANSIENT_STATE_WAITING = 0,
    WIRE_TRANSIENT_STATE_TRIGGERED = 1,
    WIRE_TRANSIENT_STATE_FROZEN = 2,
};
#define WIRE_TRANSIENT_STATE_COUNT 3

/* Every command as COMMAND(name, number, mask of the states it is allowed in, whether it locks the device
 * itself); app/commands.c makes its table of them. */
#define WIRE_ANY_STATE ((1u << WIRE_STATE_COUNT) - 1)
#define WIRE_COMMANDS(COMMAND) \
    COMMAND(hello, WIRE_HELLO, WIRE_ANY_STATE, false) \
    COMMAND(stop, WIRE_STOP, WIRE_ANY_STATE, false) \
    COMMAND(status, WIRE_STATUS, WIRE_ANY_STATE, false) \
    COMMAND(arm, WIRE_ARM, WIRE_ANY_STATE, false) \
    COMMAND(start, WIRE_START, WIRE_ANY_STATE, false) \
    COMMAND(park, WIRE_PARK, WIRE_ANY_STATE, false) \
    COMMAND(clear_fault, WIRE_CLEAR_FAULT, WIRE_ANY_STATE, false) \
    COMMAND(set_axis, WIRE_SET_AXIS, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_ARMED, false) \
    COMMAND(set_path, WIRE_SET_PATH, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_ARMED, false) \
    COMMAND(wave_chunk, WIRE_WAVE_CHUNK, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_ARMED | 1u << WIRE_STATE_RUNNING, true) \
    COMMAND(wave_commit, WIRE_WAVE_COMMIT, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_ARMED | 1u << WIRE_STATE_RUNNING, true) \
    COMMAND(model_begin, WIRE_MODEL_BEGIN, 1u << WIRE_STATE_PARKED, true) \
    COMMAND(model_chunk, WIRE_MODEL_CHUNK, 1u << WIRE_STATE_PARKED, true) \
    COMMAND(model_commit, WIRE_MODEL_COMMIT, 1u << WIRE_STATE_PARKED, true) \
    COMMAND(model_read, WIRE_MODEL_READ, WIRE_ANY_STATE, true) \
    COMMAND(model_persist, WIRE_MODEL_PERSIST, 1u << WIRE_STATE_PARKED, true) \
    COMMAND(stream_start, WIRE_STREAM_START, WIRE_ANY_STATE, true) \
    COMMAND(stream_stop, WIRE_STREAM_STOP, WIRE_ANY_STATE, false) \
    COMMAND(snapshot_read, WIRE_SNAPSHOT_READ, WIRE_ANY_STATE, true) \
    COMMAND(set_timeout, WIRE_SET_TIMEOUT, WIRE_ANY_STATE, false) \
    COMMAND(info, WIRE_INFO, WIRE_ANY_STATE, false) \
    COMMAND(motion, WIRE_MOTION, WIRE_ANY_STATE, false) \
    COMMAND(queue, WIRE_QUEUE, 1u << WIRE_STATE_RUNNING, true) \
    COMMAND(set_joins, WIRE_SET_JOINS, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_ARMED, true) \
    COMMAND(points_begin, WIRE_POINTS_BEGIN, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_ARMED | 1u << WIRE_STATE_RUNNING, true) \
    COMMAND(points, WIRE_POINTS, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_ARMED | 1u << WIRE_STATE_RUNNING, true) \
    COMMAND(trigger_set, WIRE_TRIGGER_SET, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_ARMED | 1u << WIRE_STATE_RUNNING, false) \
    COMMAND(set_gains, WIRE_SET_GAINS, WIRE_ANY_STATE, false) \
    COMMAND(where, WIRE_WHERE, WIRE_ANY_STATE, false) \
    COMMAND(update_info, WIRE_UPDATE_INFO, WIRE_ANY_STATE, true) \
    COMMAND(update_begin, WIRE_UPDATE_BEGIN, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_FAULT, true) \
    COMMAND(update_chunk, WIRE_UPDATE_CHUNK, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_FAULT, true) \
    COMMAND(update_commit, WIRE_UPDATE_COMMIT, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_FAULT, true) \
    COMMAND(update_restart, WIRE_UPDATE_RESTART, 1u << WIRE_STATE_PARKED | 1u << WIRE_STATE_FAULT, true) \
    COMMAND(update_confirm, WIRE_UPDATE_CONFIRM, WIRE_ANY_STATE, true) \
    COMMAND(limits_set, WIRE_LIMITS_SET, 1u << WIRE_STATE_PARKED, true) \
    COMMAND(limits_read, WIRE_LIMITS_READ, WIRE_ANY_STATE, false) \
    COMMAND(fault_log, WIRE_FAULT_LOG, WIRE_ANY_STATE, false) \
    COMMAND(transient_arm, WIRE_TRANSIENT_ARM, WIRE_ANY_STATE, false) \
    COMMAND(transient_read, WIRE_TRANSIENT_READ, WIRE_ANY_STATE, true)

/* Before every payload */
#define WIRE_HEADER_SIZE 11
struct wire_header {
    uint8_t type; /* message number; a reply carries the command's number + 0x80 */
    uint16_t id; /* request number, echoed by its reply; retries keep it */
    uint64_t session; /* nonce chosen by the host in HELLO */
};

/* What every reply begins with; most are no more */
#define WIRE_REPLY_HEAD_SIZE 9
struct wire_reply_head {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
};

/* One axis in one tick of a samples batch */
#define WIRE_TICK_SIZE 13
struct wire_tick {
    int32_t reference; /* um q16 (V q24 in mode open) */
    uint16_t adc; /* sensor code */
    uint16_t dac; /* output code */
    int16_t feedforward; /* V q11 */
    int16_t feedback; /* V q11 */
    uint8_t trigger; /* of the device, the same for every axis: bits 0 to 2: the trigger outputs that pulse in this tick; bit 7: an edge has come at the trigger input */
};

/* One section y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y''; stable, 1 + a1 + a2 = b0 + b1 + b2 */
#define WIRE_BIQUAD_SIZE 20
struct wire_biquad {
    int32_t b0_q26;
    int32_t b1_q26;
    int32_t b2_q26;
    int32_t a1_q26;
    int32_t a2_q26;
};

/* One axis of the model: converters, limits, the paper's table view, and the chain that mode inverse undoes */
#define WIRE_AXIS_MODEL_SIZE 900
struct wire_axis_model {
    uint32_t flags; /* bit 0: table view present; bit 1: the fields from preview_ticks_q16 on are; bits 24 to 31: what the ADC code of 0 um is above adc_zero_code, in 256ths */
    int32_t u_min_q24; /* lower clamp, V */
    int32_t u_max_q24; /* upper clamp, V */
    int32_t u_park_q24; /* safe value, V */
    int32_t slew_q24; /* largest step of the output, V per tick */
    int32_t ramp_q24; /* step when parking or ramping after a fault, V per tick; at most slew_q24 */
    int32_t dac_zero_code; /* DAC code of 0 V */
    int32_t dac_codes_per_V_q16; /* DAC scale */
    int32_t adc_zero_code; /* ADC code of 0 um, rounded down; the rest stands in flags */
    int32_t adc_um_per_code_q32; /* ADC scale */
    int32_t swing_min_q24; /* identified rectangle: peak-to-peak voltage */
    int32_t swing_max_q24;
    int32_t f_min_q16; /* identified rectangle: Hz */
    int32_t f_max_q16;
    int64_t a_q32[3]; /* K(um) in um/V, um/V^2, um/V^3 */
    int64_t b_q40[6]; /* theta(um, f) in turns (not degrees), regressors 1 um f um*f um^2 f^2 */
    int64_t c_q32[6]; /* x0(um, f) in um, same regressors; kept for read-back, not used by the law */
    uint32_t preview_ticks_q16; /* how far ahead the feed-forward looks; at most 1024 ticks */
    struct wire_biquad shape[6]; /* sections on the position that is asked for; those not in use: b0 = 1 */
    struct wire_biquad drive[1]; /* section on the voltage */
    int32_t creep_k_q30[8]; /* creep x = d + sum k lag[d]; sum |k| at most 1/2 */
    int64_t creep_alpha_q48[8]; /* 1 - exp(-T/tau) */
    int32_t gain_q20; /* x = offset + gain v + sum w play_r[v] + sum s max(v - d, 0); um/V */
    int32_t offset_q16; /* um */
    int32_t rest_fraction_q30; /* where plays stand at rest, of their thresholds */
    int32_t play_r_q24[32]; /* V, rising; those not in use: 0x7fffffff */
    int32_t play_w_q20[32]; /* um/V */
    int32_t knot_d_q24[24]; /* V, rising; those not in use: 0x7fffffff */
    int32_t knot_s_q20[24]; /* um/V */
    int32_t coupling_q28[3]; /* what this axis sees of x, y, z; its own share is 1 */
    int32_t error_limit_q16; /* under feedback, um: so far off for error_ticks in a row is a fault; 0: a quarter of the sensor's range for 500 ticks */
    uint32_t error_ticks;
    int32_t oscillation_limit_q16; /* under feedback, um rms above the loop's band: growing to more is a fault; 0: a 256th of the sensor's range */
};

/* A path for the queue: fields as in SET_PATH, unless said */
#define WIRE_SEGMENT_SIZE 30
struct wire_segment {
    uint8_t path;
    uint8_t flags; /* from_here: a hold or a move begins where the path before ends or, joined, is half a join later; the swing of a move is then its target. more: another one is to follow */
    int32_t swing;
    int32_t offset;
    uint64_t step_turn64;
    uint64_t ticks;
    uint16_t enter_ticks; /* of the join with the path before; 0: none, it begins where that one comes to rest */
    uint16_t leave_ticks;
};

/* The model blob that is uploaded, checked, persisted and read back */
#define WIRE_MODEL_SIZE 2736
struct wire_model {
    uint32_t magic; /* 0x314C4850, 'PHL1' */
    uint8_t stage_hash[32]; /* SHA-256 of the stage file it was made from */
    struct wire_axis_model axes[3];
};

/* Hard limits of one axis, in converter codes, so that no model's calibration moves them; 0, 65535 and 0xffffffff limit nothing */
#define WIRE_AXIS_LIMITS_SIZE 12
struct wire_axis_limits {
    uint16_t dac_min; /* lowest output code */
    uint16_t dac_max;
    uint32_t slew_codes_q16; /* largest step of the output, codes per tick */
    uint16_t adc_min; /* lowest sensor code of a set-point and of an axis that follows a path */
    uint16_t adc_max;
};

/* One fault of the log */
#define WIRE_LOGGED_FAULT_SIZE 19
struct wire_logged_fault {
    uint32_t power_cycle; /* starts of the device up to then, resets included; 1 is the first */
    uint64_t tick; /* since that start */
    uint32_t detail;
    uint8_t fault; /* none: no fault */
    uint8_t axis; /* 255: no axis */
    uint8_t state; /* in which it was met */
};

/* One record of the journal, never sent: its limits and power cycle hold from then on, a fault is added to the log; a CRC-32 follows */
#define WIRE_DEVICE_RECORD_SIZE 68
struct wire_device_record {
    uint32_t magic; /* 0x314A4850, 'PHJ1' */
    uint32_t sequence; /* never 0; the newest whole record wins */
    uint32_t power_cycle;
    uint8_t limits_lost; /* the limits that were set could not be read, and none have been set since */
    struct wire_axis_limits limits[3];
    struct wire_logged_fault fault[1];
};

/* 0x81: Opens a session: the header's session becomes the device's. Needs no session. */
#define WIRE_HELLO_REPLY_SIZE 79
struct wire_hello_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint32_t schema_fingerprint;
    uint16_t wire_version; /* these three stand here in every version from 2 on */
    uint16_t wire_revision; /* what has been added to the version */
    uint8_t build_id[20]; /* hash of the firmware source */
    uint8_t target[24]; /* ASCII, zero padded: host, nucleo_f446re, ... */
    uint32_t tick_rate_Hz;
    uint32_t baud;
    uint8_t axis_count;
    uint8_t state;
    uint8_t reset_cause;
    uint8_t model_flags; /* bit 0: a model is loaded; bit 1: it is a fallback and must be named to arm; bit 2: it is persisted */
    uint32_t model_crc;
    uint16_t max_payload;
};

/* 0x83: What the device is doing; also feeds the host timeout */
#define WIRE_STATUS_REPLY_SIZE 73
struct wire_status_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint8_t state;
    uint8_t fault;
    uint8_t fault_axis; /* 255: no axis */
    uint8_t running_axes; /* mask of axes whose path is still under way */
    uint64_t fault_tick;
    uint8_t modes[3];
    uint8_t at_rest; /* mask of axes whose output is at the safe value */
    uint16_t adc_codes[3];
    uint16_t dac_codes[3];
    uint32_t saturations[3]; /* ticks with at least one saturated block, per axis */
    uint32_t overruns;
    uint32_t stream_dropped; /* ticks dropped since the stream was started */
    uint32_t rx_errors; /* frames thrown away: bad COBS, CRC or length */
    uint32_t model_crc;
    uint64_t first_tick; /* in which the paths begin that an edge at the trigger input has begun; 0: those queued last still wait for one */
};

/* 0x04: parked -> armed. model_crc 0 arms whatever is loaded unless it is a fallback, which must be named */
#define WIRE_ARM_REQUEST_SIZE 4
struct wire_arm_request {
    uint32_t model_crc;
};

/* 0x05: armed -> running: the paths of these axes begin together */
#define WIRE_START_REQUEST_SIZE 1
struct wire_start_request {
    uint8_t axis_mask;
};

/* 0x85: armed -> running: the paths of these axes begin together */
#define WIRE_START_REPLY_SIZE 17
struct wire_start_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint64_t first_tick; /* in which they begin: the one after the reply's, which works out what they begin with */
};

/* 0x08: Mode, gains and filters of one axis; while parked or armed */
#define WIRE_SET_AXIS_REQUEST_SIZE 58
struct wire_set_axis_request {
    uint8_t axis;
    uint8_t mode;
    int32_t kp_q24; /* V/um */
    int32_t ki_ts_q32; /* V/um per tick */
    int32_t kd_over_ts_q24; /* V/um */
    int32_t d_alpha_q31; /* derivative filter y += alpha (x - y); 0x7fffffff: no filter */
    struct wire_biquad filters[2]; /* behind the PID, one after the other; all of it 0: none */
};

/* 0x09: Reference of one axis; while parked or armed. Looks the feed-forward tables up and refuses what they do not cover */
#define WIRE_SET_PATH_REQUEST_SIZE 26
struct wire_set_path_request {
    uint8_t axis;
    uint8_t path;
    int32_t swing; /* peak-to-peak, um q16 (V q24 in mode open); for a move: the way to go, signed */
    int32_t offset; /* lowest value of the path; for a hold or a move: where it starts */
    uint64_t step_turn64; /* sine, wave: turns per tick; move: 2^64 / duration in ticks */
    uint64_t ticks; /* length of the path; the last value is then held; 0: for ever */
};

/* 0x89: Reference of one axis; while parked or armed. Looks the feed-forward tables up and refuses what they do not cover */
#define WIRE_SET_PATH_REPLY_SIZE 17
struct wire_set_path_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    int32_t inverse_gain_q28; /* V/um, looked up */
    int32_t lead_turn32; /* phase lead, looked up; under inverse: the preview */
};

/* 0x0A: Writes points of an axis' periodic waveform; also while another one of its paths goes on. One period is 1024 points in q30 of the swing (0 .. 2^30) */
#define WIRE_WAVE_CHUNK_REQUEST_SIZE 3
struct wire_wave_chunk_request {
    uint8_t axis;
    uint16_t offset; /* first point */
    const uint8_t *data; /* i32 points */
    size_t data_size;
};

/* 0x0B: Checks the CRC-32 over all 1024 points and makes them the axis' waveform */
#define WIRE_WAVE_COMMIT_REQUEST_SIZE 13
struct wire_wave_commit_request {
    uint8_t axis;
    uint32_t crc;
    uint32_t model_crc; /* of the model that these points were learned with; 0: they are for any */
    uint32_t path_crc; /* of the path they were learned for: CRC-32 over the axis' mode (u8) and swing, offset and step_turn64 as SET_PATH and QUEUE have them; 0: they are for any */
};

/* 0x0C: Opens a model transaction; an earlier unfinished one is dropped */
#define WIRE_MODEL_BEGIN_REQUEST_SIZE 8
struct wire_model_begin_request {
    uint32_t size;
    uint32_t crc;
};

/* 0x0D: Part of the model blob */
#define WIRE_MODEL_CHUNK_REQUEST_SIZE 4
struct wire_model_chunk_request {
    uint32_t offset;
    const uint8_t *data;
    size_t data_size;
};

/* 0x8E: Checks the CRC, validates every field, expands the tables and swaps the model in between two ticks; while parked and no output moves */
#define WIRE_MODEL_COMMIT_REPLY_SIZE 12
struct wire_model_commit_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint16_t invalid_field; /* with model_invalid: 100 * axis + number of the offending field */
    uint8_t held_back; /* mask of axes for which the device's hard limits are tighter than the model's */
};

/* 0x0F: Reads the active model back */
#define WIRE_MODEL_READ_REQUEST_SIZE 6
struct wire_model_read_request {
    uint32_t offset;
    uint16_t length;
};

/* 0x8F: Reads the active model back */
#define WIRE_MODEL_READ_REPLY_SIZE 17
struct wire_model_read_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint32_t size;
    uint32_t crc;
    const uint8_t *data;
    size_t data_size;
};

/* 0x90: Writes the active model to the older of two flash slots; while parked and no output moves */
#define WIRE_MODEL_PERSIST_REPLY_SIZE 13
struct wire_model_persist_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint32_t sequence; /* number of the record written */
};

/* 0x11: Streams the chosen channels of the chosen axes from the reply's tick on, and latches the control state of that moment for SNAPSHOT_READ */
#define WIRE_STREAM_START_REQUEST_SIZE 4
struct wire_stream_start_request {
    uint8_t channels;
    uint8_t axis_mask;
    uint16_t decimation; /* 1: every tick */
};

/* 0x91: Streams the chosen channels of the chosen axes from the reply's tick on, and latches the control state of that moment for SNAPSHOT_READ */
#define WIRE_STREAM_START_REPLY_SIZE 21
struct wire_stream_start_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint32_t bytes_per_s; /* what it takes on the line */
    uint32_t budget_bytes_per_s; /* what the line carries */
    uint32_t state_size; /* bytes of the latched control state */
};

/* 0x92: Ends the stream; what is buffered is still sent */
#define WIRE_STREAM_STOP_REPLY_SIZE 25
struct wire_stream_stop_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint64_t sent_ticks;
    uint64_t dropped_ticks;
};

/* 0x13: Reads the control state latched by STREAM_START, a waveform, or FAULT_LOG in pieces: power_cycle, then each of its faults, newest first */
#define WIRE_SNAPSHOT_READ_REQUEST_SIZE 7
struct wire_snapshot_read_request {
    uint8_t region;
    uint32_t offset;
    uint16_t length;
};

/* 0x93: Reads the control state latched by STREAM_START, a waveform, or FAULT_LOG in pieces: power_cycle, then each of its faults, newest first */
#define WIRE_SNAPSHOT_READ_REPLY_SIZE 13
struct wire_snapshot_read_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint32_t size;
    const uint8_t *data;
    size_t data_size;
};

/* 0x14: Ticks without a valid command of the session after which an armed or running device ramps to park and latches host_timeout; 0: never */
#define WIRE_SET_TIMEOUT_REQUEST_SIZE 4
struct wire_set_timeout_request {
    uint32_t ticks;
};

/* 0x95: Timing of the tick and the fault log */
#define WIRE_INFO_REPLY_SIZE 108
struct wire_info_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint32_t cycles_last;
    uint32_t cycles_max;
    uint32_t histogram[16]; /* ticks by log2 of cycles */
    uint32_t overruns;
    uint32_t latched_late; /* ticks whose output was written too late for 30 us after the sample */
    uint32_t lost_ticks; /* ticks that did not come at all */
    uint8_t brown_out_level; /* of the chip's option bytes; 0: its brown-out reset is off */
    uint8_t last_fault;
    uint32_t last_fault_detail;
    uint32_t flash_sequence;
    uint8_t model_flags; /* as in HELLO, at present */
    uint32_t model_crc;
};

/* 0x40: Limits of what is queued from now on, and the window of `where` and of the mark `target`; no output of an axis depends on them */
#define WIRE_MOTION_REQUEST_SIZE 33
struct wire_motion_request {
    uint8_t axis;
    uint64_t velocity; /* um q40 (V q48 in mode open) per tick; 0: no limit */
    uint64_t acceleration; /* the same per tick^2 */
    uint64_t jerk; /* the same per tick^3 */
    int32_t window_q16; /* um: on target is no further from the reference than this */
    uint32_t window_ticks; /* for so long in a row */
};

/* 0x41: Puts a path behind those that are under way: one for each axis of the mask, all of them or none. They begin in the same tick */
#define WIRE_QUEUE_REQUEST_SIZE 101
struct wire_queue_request {
    uint8_t axis_mask;
    uint8_t at_once; /* 1: what is queued for these axes is dropped, and the paths under way are left */
    uint64_t begin_tick; /* 0: when the paths before have ended; those without an end are left at once */
    struct wire_segment segments[3]; /* of axes x, y, z */
    uint8_t at_trigger; /* 1: nor before an edge of the trigger input: the next one from then on; an EVENT and STATUS say when */
};

/* 0xC1: Puts a path behind those that are under way: one for each axis of the mask, all of them or none. They begin in the same tick */
#define WIRE_QUEUE_REPLY_SIZE 12
struct wire_queue_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint8_t queued[3]; /* how many wait now */
};

/* 0x44: How the path of one axis is entered and left when it is started; after SET_PATH, which sets none */
#define WIRE_SET_JOINS_REQUEST_SIZE 6
struct wire_set_joins_request {
    uint8_t axis;
    uint8_t flags;
    uint16_t enter_ticks; /* of the join from where the axis stands, before the path begins; 0: none, the output jumps there at the slew limit */
    uint16_t leave_ticks; /* of the join to a hold where a periodic path ends; 0: none, it stops in one tick */
};

/* 0x45: The waveforms of these axes are from now on paths whose points come while they are played: a ring of 1024, filled by POINTS. Set such a path, or queue it, once points are there: kind wave, step 2^(54 - ticks_log2), without an end */
#define WIRE_POINTS_BEGIN_REQUEST_SIZE 18
struct wire_points_begin_request {
    uint8_t axis_mask;
    uint8_t ticks_log2; /* a point every 2^n ticks */
    int32_t first; /* number of the first point; the path begins at point 0, those before are for the join into it */
    uint32_t steepest_q30[3]; /* no two neighbours of an axis are further apart */
};

/* 0x46: More points of these axes, the same number for each. As long as points are missing a path ends so early that those that are there suffice for its join to a hold, and is then `dry` */
#define WIRE_POINTS_REQUEST_SIZE 13
struct wire_points_request {
    uint8_t axis_mask;
    int32_t first; /* number of the first of these points */
    uint64_t length_ticks; /* of the path; 0: not known yet */
    const uint8_t *data; /* i32 points in q30 of the swing, those of the first axis before those of the next */
    size_t data_size;
};

/* 0xC6: More points of these axes, the same number for each. As long as points are missing a path ends so early that those that are there suffice for its join to a hold, and is then `dry` */
#define WIRE_POINTS_REPLY_SIZE 15
struct wire_points_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint16_t room; /* for so many more of each axis */
    uint32_t left_ticks; /* until the path that is played ends or runs dry; 0: none is */
};

/* 0x47: Where one of the three trigger outputs pulses, on the path of one axis; until another is set, or the session, the model or the hard limits change */
#define WIRE_TRIGGER_SET_REQUEST_SIZE 12
struct wire_trigger_set_request {
    uint8_t output; /* 0 to 2 */
    uint8_t mark; /* turn: where a periodic path begins, and so often a turn; time: where a path begins, and every so many ticks; way: where the reference passes one of the places; target: once after each change of the reference, when it rests and the axis has been within its window for as long as MOTION says */
    uint8_t axis;
    uint8_t rising; /* way: 1: on the way up alone */
    uint32_t every; /* turn: so many a turn; time: ticks; way: um q16 (V q24 in mode open) from place to place */
    int32_t origin; /* way: one of the places */
};

/* 0x42: Gains and filters of one axis, also while it runs: the output goes on from where it is */
#define WIRE_SET_GAINS_REQUEST_SIZE 57
struct wire_set_gains_request {
    uint8_t axis;
    int32_t kp_q24; /* V/um */
    int32_t ki_ts_q32; /* V/um per tick */
    int32_t kd_over_ts_q24; /* V/um */
    int32_t d_alpha_q31;
    struct wire_biquad filters[2]; /* as in SET_AXIS */
};

/* 0xC3: Where the axes are, and where they go; also feeds the host timeout */
#define WIRE_WHERE_REPLY_SIZE 96
struct wire_where_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint8_t state;
    uint8_t fault;
    uint8_t driven; /* mask of axes that follow a path, or hold its end */
    uint8_t moving; /* mask of axes whose path, join or queue is not at its end */
    uint8_t on_target; /* mask of axes within their window for long enough */
    uint8_t dry; /* mask of axes whose last path ended with `more` and had none after it: they hold */
    uint8_t queued[3];
    uint16_t adc_codes[3];
    int32_t u_q24[3]; /* V */
    int32_t reference[3]; /* um q16 (V q24 in mode open) */
    int32_t end[3]; /* where the last path of the queue ends: a move's target; of others, their offset; of a hold from_here that waits, the reference */
    uint32_t near_ticks[3]; /* ticks in a row within the window */
    uint64_t dry_ticks[3]; /* of axes that are dry: the tick in which the path ended */
};

/* 0xB0: Which firmware image runs, and what one must be linked for to replace it */
#define WIRE_UPDATE_INFO_REPLY_SIZE 28
struct wire_update_info_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint8_t slot; /* that runs */
    uint8_t standing; /* rolled_back: an image in the other slot was given up */
    uint8_t attempts; /* starts that an image on trial has */
    uint32_t slot_size;
    uint32_t free_address; /* of the slot that does not run */
    uint32_t version; /* major << 16, minor << 8, patch; 0: unknown */
    uint32_t trial_ticks; /* after which an image that was not confirmed restarts */
};

/* 0x31: Checks an image's header and erases the slot that does not run; while parked or in fault, at 0 V */
#define WIRE_UPDATE_BEGIN_REQUEST_SIZE 64
struct wire_update_begin_request {
    uint8_t header[64]; /* the image's first 64 bytes: magic, CRC, length, address, version, target, build id */
};

/* 0x32: Part of the image behind its header; programmed and read back */
#define WIRE_UPDATE_CHUNK_REQUEST_SIZE 4
struct wire_update_chunk_request {
    uint32_t offset; /* from the image's beginning */
    const uint8_t *data;
    size_t data_size;
};

/* 0x35: The image on trial is to stay: the host has spoken with it and read its build id */
#define WIRE_UPDATE_CONFIRM_REQUEST_SIZE 20
struct wire_update_confirm_request {
    uint8_t build_id[20];
};

/* 0x20: Sets the hard limits of all axes and keeps them in flash; while parked and no output moves. Modes and paths have to be set again */
#define WIRE_LIMITS_SET_REQUEST_SIZE 36
struct wire_limits_set_request {
    struct wire_axis_limits limits[3];
};

/* 0xA1: The hard limits in force */
#define WIRE_LIMITS_READ_REPLY_SIZE 46
struct wire_limits_read_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint8_t limits_lost; /* 1: what was set could not be read; arming is refused until limits are set */
    struct wire_axis_limits limits[3];
};

/* 0xA2: The last 16 faults, those before the last resets included */
#define WIRE_FAULT_LOG_REPLY_SIZE 318
struct wire_fault_log_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint32_t power_cycle; /* starts of the device, resets included */
    uint8_t count;
    struct wire_logged_fault faults[16]; /* oldest first */
};

/* 0x23: Chooses the transient recorder's trigger beside a fault, empties it and lets it wait */
#define WIRE_TRANSIENT_ARM_REQUEST_SIZE 12
struct wire_transient_arm_request {
    uint8_t trigger;
    uint8_t axis; /* threshold: whose channel */
    uint8_t channel; /* threshold: reference, adc or dac */
    uint8_t falling; /* threshold: 0: from below, 1: from above */
    int32_t level; /* threshold: in the unit of the channel */
    uint16_t decimation; /* 1: every tick */
    uint16_t after; /* entries after the one of the trigger */
};

/* 0xA3: Chooses the transient recorder's trigger beside a fault, empties it and lets it wait */
#define WIRE_TRANSIENT_ARM_REPLY_SIZE 11
struct wire_transient_arm_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint16_t entries; /* so many it holds */
};

/* 0x24: What the transient recorder does, and once it is frozen what it holds, oldest first: per entry the tick (u32, its low half) and for each axis the first five fields of [tick] */
#define WIRE_TRANSIENT_READ_REQUEST_SIZE 6
struct wire_transient_read_request {
    uint32_t offset;
    uint16_t length;
};

/* 0xA4: What the transient recorder does, and once it is frozen what it holds, oldest first: per entry the tick (u32, its low half) and for each axis the first five fields of [tick] */
#define WIRE_TRANSIENT_READ_REPLY_SIZE 28
struct wire_transient_read_reply {
    uint8_t status;
    uint64_t tick; /* the tick before which the command took effect */
    uint8_t state;
    uint8_t cause;
    uint64_t trigger_tick;
    uint16_t decimation;
    uint8_t modes[3]; /* at the trigger */
    uint32_t size; /* bytes that it holds; 0 as long as it is not frozen */
    const uint8_t *data; /* may be less than was asked for */
    size_t data_size;
};

/* 0x70: A batch of ticks, never retransmitted. `data` holds, per tick and for each axis of the mask, the fields of [tick] that `channels` asks for, in their order */
#define WIRE_SAMPLES_SIZE 20
struct wire_samples {
    uint32_t sequence;
    uint64_t first_tick;
    uint32_t dropped; /* ticks dropped since the stream was started, before this batch */
    uint8_t channels;
    uint8_t axis_mask;
    uint16_t decimation;
    const uint8_t *data;
    size_t data_size;
};

/* 0x71: A change of state, a fault, the end of a path, an edge at the trigger input that was waited for */
#define WIRE_EVENT_SIZE 13
struct wire_event {
    uint64_t tick;
    uint8_t kind;
    uint32_t value; /* state_change: the state; fault: the fault; path_done: the axis; stream_overflow: ticks dropped so far; trigger: mask of the axes whose paths it begins */
};

#define WIRE_HELLO_REQUEST_SIZE 0 /* Opens a session: the header's session becomes the device's. Needs no session. */
#define WIRE_STOP_REQUEST_SIZE 0 /* Ramps every axis to its safe value at once. Needs no session. */
#define WIRE_STOP_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_STATUS_REQUEST_SIZE 0 /* What the device is doing; also feeds the host timeout */
#define WIRE_ARM_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_PARK_REQUEST_SIZE 0 /* Ramps to the safe value, then parked */
#define WIRE_PARK_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_CLEAR_FAULT_REQUEST_SIZE 0 /* fault -> parked once the output is at its safe value */
#define WIRE_CLEAR_FAULT_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_SET_AXIS_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_WAVE_CHUNK_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_WAVE_COMMIT_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_MODEL_BEGIN_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_MODEL_CHUNK_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_MODEL_COMMIT_REQUEST_SIZE 0 /* Checks the CRC, validates every field, expands the tables and swaps the model in between two ticks; while parked and no output moves */
#define WIRE_MODEL_PERSIST_REQUEST_SIZE 0 /* Writes the active model to the older of two flash slots; while parked and no output moves */
#define WIRE_STREAM_STOP_REQUEST_SIZE 0 /* Ends the stream; what is buffered is still sent */
#define WIRE_SET_TIMEOUT_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_INFO_REQUEST_SIZE 0 /* Timing of the tick and the fault log */
#define WIRE_MOTION_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_SET_JOINS_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_POINTS_BEGIN_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_TRIGGER_SET_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_SET_GAINS_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_WHERE_REQUEST_SIZE 0 /* Where the axes are, and where they go; also feeds the host timeout */
#define WIRE_UPDATE_INFO_REQUEST_SIZE 0 /* Which firmware image runs, and what one must be linked for to replace it */
#define WIRE_UPDATE_BEGIN_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_UPDATE_CHUNK_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_UPDATE_COMMIT_REQUEST_SIZE 0 /* Checks the CRC over what is in flash, programs the header, and puts the image on trial at the next start */
#define WIRE_UPDATE_COMMIT_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_UPDATE_RESTART_REQUEST_SIZE 0 /* Restarts the device, 20 ms after the reply; while parked or in fault, at 0 V */
#define WIRE_UPDATE_RESTART_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_UPDATE_CONFIRM_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_LIMITS_SET_REPLY_SIZE WIRE_REPLY_HEAD_SIZE
#define WIRE_LIMITS_READ_REQUEST_SIZE 0 /* The hard limits in force */
#define WIRE_FAULT_LOG_REQUEST_SIZE 0 /* The last 16 faults, those before the last resets included */

/* Size without what revisions added, and with it; bytes may follow a message with a tail. */
struct wire_message_size {
    uint16_t least;
    uint16_t fixed;
    bool has_tail;
};

/* NULL for a number that is no message. */
const struct wire_message_size *wire_message_size(uint8_t type);
/* For messages; NULL for a number that is no message. A reply has its command's name. */
const char *wire_message_name(uint8_t type);

/* Bytes of one axis in one tick of a samples batch. */
size_t wire_tick_size(uint8_t channels);
/* Writes the chosen channels of one axis; returns the end of what was written. */
uint8_t *wire_put_tick(uint8_t *out, uint8_t channels, const struct wire_tick *tick);

/* Packing returns the bytes written, or -1 when `capacity` or WIRE_MAX_PAYLOAD does not hold them.
 * Unpacking returns false unless `size` is right; a tail points into `in`. */
int32_t wire_pack_header(const struct wire_header *from, uint8_t *out, size_t capacity);
bool wire_unpack_header(struct wire_header *to, const uint8_t *in, size_t size);
int32_t wire_pack_reply_head(const struct wire_reply_head *from, uint8_t *out, size_t capacity);
bool wire_unpack_reply_head(struct wire_reply_head *to, const uint8_t *in, size_t size);
int32_t wire_pack_biquad(const struct wire_biquad *from, uint8_t *out, size_t capacity);
bool wire_unpack_biquad(struct wire_biquad *to, const uint8_t *in, size_t size);
int32_t wire_pack_axis_model(const struct wire_axis_model *from, uint8_t *out, size_t capacity);
bool wire_unpack_axis_model(struct wire_axis_model *to, const uint8_t *in, size_t size);
int32_t wire_pack_segment(const struct wire_segment *from, uint8_t *out, size_t capacity);
bool wire_unpack_segment(struct wire_segment *to, const uint8_t *in, size_t size);
int32_t wire_pack_model(const struct wire_model *from, uint8_t *out, size_t capacity);
bool wire_unpack_model(struct wire_model *to, const uint8_t *in, size_t size);
int32_t wire_pack_axis_limits(const struct wire_axis_limits *from, uint8_t *out, size_t capacity);
bool wire_unpack_axis_limits(struct wire_axis_limits *to, const uint8_t *in, size_t size);
int32_t wire_pack_logged_fault(const struct wire_logged_fault *from, uint8_t *out, size_t capacity);
bool wire_unpack_logged_fault(struct wire_logged_fault *to, const uint8_t *in, size_t size);
int32_t wire_pack_device_record(const struct wire_device_record *from, uint8_t *out, size_t capacity);
bool wire_unpack_device_record(struct wire_device_record *to, const uint8_t *in, size_t size);
int32_t wire_pack_hello_reply(const struct wire_hello_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_hello_reply(struct wire_hello_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_status_reply(const struct wire_status_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_status_reply(struct wire_status_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_arm_request(const struct wire_arm_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_arm_request(struct wire_arm_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_start_request(const struct wire_start_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_start_request(struct wire_start_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_start_reply(const struct wire_start_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_start_reply(struct wire_start_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_set_axis_request(const struct wire_set_axis_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_set_axis_request(struct wire_set_axis_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_set_path_request(const struct wire_set_path_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_set_path_request(struct wire_set_path_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_set_path_reply(const struct wire_set_path_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_set_path_reply(struct wire_set_path_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_wave_chunk_request(const struct wire_wave_chunk_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_wave_chunk_request(struct wire_wave_chunk_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_wave_commit_request(const struct wire_wave_commit_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_wave_commit_request(struct wire_wave_commit_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_model_begin_request(const struct wire_model_begin_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_model_begin_request(struct wire_model_begin_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_model_chunk_request(const struct wire_model_chunk_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_model_chunk_request(struct wire_model_chunk_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_model_commit_reply(const struct wire_model_commit_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_model_commit_reply(struct wire_model_commit_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_model_read_request(const struct wire_model_read_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_model_read_request(struct wire_model_read_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_model_read_reply(const struct wire_model_read_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_model_read_reply(struct wire_model_read_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_model_persist_reply(const struct wire_model_persist_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_model_persist_reply(struct wire_model_persist_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_stream_start_request(const struct wire_stream_start_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_stream_start_request(struct wire_stream_start_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_stream_start_reply(const struct wire_stream_start_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_stream_start_reply(struct wire_stream_start_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_stream_stop_reply(const struct wire_stream_stop_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_stream_stop_reply(struct wire_stream_stop_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_snapshot_read_request(const struct wire_snapshot_read_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_snapshot_read_request(struct wire_snapshot_read_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_snapshot_read_reply(const struct wire_snapshot_read_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_snapshot_read_reply(struct wire_snapshot_read_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_set_timeout_request(const struct wire_set_timeout_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_set_timeout_request(struct wire_set_timeout_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_info_reply(const struct wire_info_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_info_reply(struct wire_info_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_motion_request(const struct wire_motion_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_motion_request(struct wire_motion_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_queue_request(const struct wire_queue_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_queue_request(struct wire_queue_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_queue_reply(const struct wire_queue_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_queue_reply(struct wire_queue_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_set_joins_request(const struct wire_set_joins_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_set_joins_request(struct wire_set_joins_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_points_begin_request(const struct wire_points_begin_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_points_begin_request(struct wire_points_begin_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_points_request(const struct wire_points_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_points_request(struct wire_points_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_points_reply(const struct wire_points_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_points_reply(struct wire_points_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_trigger_set_request(const struct wire_trigger_set_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_trigger_set_request(struct wire_trigger_set_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_set_gains_request(const struct wire_set_gains_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_set_gains_request(struct wire_set_gains_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_where_reply(const struct wire_where_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_where_reply(struct wire_where_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_update_info_reply(const struct wire_update_info_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_update_info_reply(struct wire_update_info_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_update_begin_request(const struct wire_update_begin_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_update_begin_request(struct wire_update_begin_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_update_chunk_request(const struct wire_update_chunk_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_update_chunk_request(struct wire_update_chunk_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_update_confirm_request(const struct wire_update_confirm_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_update_confirm_request(struct wire_update_confirm_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_limits_set_request(const struct wire_limits_set_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_limits_set_request(struct wire_limits_set_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_limits_read_reply(const struct wire_limits_read_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_limits_read_reply(struct wire_limits_read_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_fault_log_reply(const struct wire_fault_log_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_fault_log_reply(struct wire_fault_log_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_transient_arm_request(const struct wire_transient_arm_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_transient_arm_request(struct wire_transient_arm_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_transient_arm_reply(const struct wire_transient_arm_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_transient_arm_reply(struct wire_transient_arm_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_transient_read_request(const struct wire_transient_read_request *from, uint8_t *out, size_t capacity);
bool wire_unpack_transient_read_request(struct wire_transient_read_request *to, const uint8_t *in, size_t size);
int32_t wire_pack_transient_read_reply(const struct wire_transient_read_reply *from, uint8_t *out, size_t capacity);
bool wire_unpack_transient_read_reply(struct wire_transient_read_reply *to, const uint8_t *in, size_t size);
int32_t wire_pack_samples(const struct wire_samples *from, uint8_t *out, size_t capacity);
bool wire_unpack_samples(struct wire_samples *to, const uint8_t *in, size_t size);
int32_t wire_pack_event(const struct wire_event *from, uint8_t *out, size_t capacity);
bool wire_unpack_event(struct wire_event *to, const uint8_t *in, size_t size);

#endif
