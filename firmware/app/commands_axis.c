/* Mode, gains, path and waveform of an axis. */
#include <string.h>

#include "app/command.h"
#include "app/crc32.h"
#include "core/fixed.h"
#include "core/inverse_make.h"

#define WAVE_ONE_Q30 (1 << 30)
#define HALF_TURN64 ((uint64_t)1 << 63)

enum wire_status command_set_axis(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_set_axis_request set;
    (void)answer;
    wire_unpack_set_axis_request(&set, request->payload, request->size);
    if (set.axis >= AXES || set.mode >= WIRE_MODE_COUNT || set.kp_q24 < 0 || set.ki_ts_q32 < 0 ||
        set.kd_over_ts_q24 < 0 || set.d_alpha_q31 <= 0)
        return WIRE_STATUS_BAD_VALUE;
    if (axis_mode_uses_tables(set.mode) && !device_tables(device, set.axis))
        return WIRE_STATUS_NO_MODEL;
    if (axis_mode_inverts(set.mode) && !device_compensation(device, set.axis))
        return WIRE_STATUS_NO_MODEL;
    struct axis_config *config = &device->control.config[set.axis];
    config->mode = set.mode;
    config->pid = (struct pid_config){set.kp_q24, set.ki_ts_q32, set.kd_over_ts_q24, set.d_alpha_q31};
    memset(&config->path, 0, sizeof config->path); /* its unit may have changed with the mode */
    memset(&config->point, 0, sizeof config->point);
    axis_set_reference(config, &device->model_of[set.axis], &device->control.axis[set.axis]);
    device_wake(device, set.axis);
    device->control.path_mask &= ~(1u << set.axis);
    return WIRE_STATUS_OK;
}

static bool is_periodic(uint8_t path)
{
    return path == PATH_SINE || path == PATH_WAVE;
}

/* turns per tick x ticks per second, to nearest, so that the ends of the rectangle are inside it. */
static int32_t frequency_q16(uint64_t step_turn64)
{
    uint64_t high = (step_turn64 >> 32) * TICK_RATE_HZ;
    uint64_t low = (step_turn64 & UINT32_MAX) * TICK_RATE_HZ >> 32;
    return (int32_t)((high + low + (1u << 15)) >> 16);
}

/* Lowest and highest value of a path, in its own unit. */
static void path_span(const struct wire_set_path_request *set, int64_t *low, int64_t *high)
{
    int64_t end = set->path == PATH_HOLD ? set->offset : (int64_t)set->offset + set->swing;
    *low = end < set->offset ? end : set->offset;
    *high = end < set->offset ? set->offset : end;
}

static bool path_is_sane(const struct wire_set_path_request *set)
{
    if (set->path == PATH_HOLD)
        return true;
    if (is_periodic(set->path) && set->swing < 0)
        return false;
    return set->step_turn64 != 0 && set->step_turn64 < HALF_TURN64;
}

static bool within(int64_t low, int64_t high, int64_t least, int64_t most)
{
    return low >= least && high <= most;
}

/* The feed-forward voltage of a position. */
static int64_t static_u_q24(const struct feedforward_tables *tables, const struct feedforward_point *point,
                            bool periodic, int64_t position_q16)
{
    bool saturated = false;
    int32_t u_q24 = periodic ? feedforward_step_q24(point, (int32_t)position_q16, &saturated)
                             : feedforward_static_q24(tables, (int32_t)position_q16);
    return saturated ? INT64_MAX : u_q24;
}

static enum wire_status check_tables(const struct device *device, const struct wire_set_path_request *set,
                                     int64_t low_q16, int64_t high_q16, struct feedforward_point *point)
{
    const struct feedforward_tables *tables = device_tables(device, set->axis);
    const struct output_config *output = &device->control.config[set->axis].output;
    bool periodic = is_periodic(set->path);
    if (!tables)
        return WIRE_STATUS_NO_MODEL;
    if (periodic && !feedforward_lookup(tables, set->swing, frequency_q16(set->step_turn64), point))
        return WIRE_STATUS_OUTSIDE_RECTANGLE;
    if (!periodic && !within(low_q16, high_q16, -(int64_t)tables->range_max_q16, tables->range_max_q16))
        return WIRE_STATUS_OUTSIDE_RECTANGLE;
    int64_t low_q24 = static_u_q24(tables, point, periodic, low_q16);
    int64_t high_q24 = static_u_q24(tables, point, periodic, high_q16);
    return within(low_q24, high_q24, output->u_min_q24, output->u_max_q24) ? WIRE_STATUS_OK
                                                                           : WIRE_STATUS_OUTSIDE_LIMITS;
}

/* step x preview; whole turns wrap around. */
static int32_t preview_turn32(const struct compensation *compensation, uint64_t step_turn64)
{
    uint64_t ticks_q16 = compensation->preview_ticks_q16;
    uint64_t lead_turn64 = ((step_turn64 >> 32) * ticks_q16 << 16) + ((step_turn64 & UINT32_MAX) * ticks_q16 >> 16);
    return (int32_t)(uint32_t)((lead_turn64 + (1u << 31)) >> 32);
}

static enum wire_status check_inverse(const struct device *device, const struct wire_set_path_request *set,
                                      int64_t low_q16, int64_t high_q16, struct feedforward_point *point)
{
    const struct compensation *compensation = device_compensation(device, set->axis);
    int32_t least_q16, most_q16;
    if (!compensation)
        return WIRE_STATUS_NO_MODEL;
    inverse_reach_q16(&compensation->inverse, &least_q16, &most_q16);
    if (is_periodic(set->path))
        point->lead_turn32 = preview_turn32(compensation, set->step_turn64);
    return within(low_q16, high_q16, least_q16, most_q16) ? WIRE_STATUS_OK : WIRE_STATUS_OUTSIDE_LIMITS;
}

static enum wire_status check_path(const struct device *device, const struct wire_set_path_request *set,
                                   struct feedforward_point *point)
{
    const struct axis_config *config = &device->control.config[set->axis];
    bool saturated = false;
    int64_t low, high;
    if (config->mode == AXIS_IDLE)
        return WIRE_STATUS_MODE_UNSUPPORTED; /* the path's unit depends on the mode */
    if (!path_is_sane(set) || (set->path == PATH_WAVE && !device_wave_q30(device, set->axis)))
        return WIRE_STATUS_BAD_VALUE;
    path_span(set, &low, &high);
    if (config->mode == AXIS_OPEN)
        return within(low, high, config->output.u_min_q24, config->output.u_max_q24) ? WIRE_STATUS_OK
                                                                                     : WIRE_STATUS_OUTSIDE_LIMITS;
    if (!within(low, high, converter_position_q16(&config->converter, (uint16_t)config->code_min, &saturated),
                converter_position_q16(&config->converter, (uint16_t)config->code_max, &saturated)))
        return WIRE_STATUS_OUTSIDE_LIMITS;
    if (axis_mode_inverts(config->mode))
        return check_inverse(device, set, low, high, point);
    return axis_mode_uses_tables(config->mode) ? check_tables(device, set, low, high, point) : WIRE_STATUS_OK;
}

enum wire_status command_set_path(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_set_path_request set;
    struct feedforward_point point = {0, 0};
    wire_unpack_set_path_request(&set, request->payload, request->size);
    if (set.axis >= AXES || set.path >= WIRE_PATH_KIND_COUNT)
        return WIRE_STATUS_BAD_VALUE;
    enum wire_status status = check_path(device, &set, &point);
    if (status != WIRE_STATUS_OK)
        return status;
    struct axis_config *config = &device->control.config[set.axis];
    config->path = (struct path_config){
        .kind = set.path, .swing = set.swing, .offset = set.offset, .step_turn64 = set.step_turn64, .ticks = set.ticks};
    config->point = point;
    axis_set_reference(config, &device->model_of[set.axis], &device->control.axis[set.axis]);
    device_wake(device, set.axis);
    device->control.path_mask |= 1u << set.axis;
    struct wire_set_path_reply reply = {.inverse_gain_q28 = point.inverse_gain_q28, .lead_turn32 = point.lead_turn32};
    wire_pack_set_path_reply(&reply, answer->payload, answer->size);
    return WIRE_STATUS_OK;
}

static int32_t point_at(const uint8_t *data)
{
    int32_t point;
    memcpy(&point, data, sizeof point);
    return point;
}

enum wire_status command_wave_chunk(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_wave_chunk_request chunk;
    (void)answer;
    wire_unpack_wave_chunk_request(&chunk, request->payload, request->size);
    size_t points = chunk.data_size / sizeof(int32_t);
    if (chunk.axis >= AXES || points == 0 || chunk.data_size % sizeof(int32_t) != 0 || chunk.offset >= WAVE_POINTS ||
        points > WAVE_POINTS - (size_t)chunk.offset)
        return WIRE_STATUS_BAD_VALUE;
    for (size_t i = 0; i < points; i++) {
        int32_t point = point_at(chunk.data + i * sizeof point);
        if (point < 0 || point > WAVE_ONE_Q30)
            return WIRE_STATUS_BAD_VALUE;
    }
    device_lock(device);
    device->wave_mask &= ~(1u << chunk.axis); /* incomplete until its commit */
    device_link_models(device);
    device_unlock(device);
    memcpy(&device->waves_q30[chunk.axis][chunk.offset], chunk.data, chunk.data_size);
    return WIRE_STATUS_OK;
}

enum wire_status command_wave_commit(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_wave_commit_request commit;
    wire_unpack_wave_commit_request(&commit, request->payload, request->size);
    if (commit.axis >= AXES)
        return WIRE_STATUS_BAD_VALUE;
    if (crc32(0, (const uint8_t *)device->waves_q30[commit.axis], sizeof device->waves_q30[0]) != commit.crc)
        return WIRE_STATUS_CRC_MISMATCH;
    device_lock(device);
    answer->tick = device->control.tick;
    device->wave_mask |= 1u << commit.axis;
    device_link_models(device);
    device_unlock(device);
    return WIRE_STATUS_OK;
}
