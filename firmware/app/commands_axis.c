/* Mode, gains, path and waveform of an axis. */
#include <string.h>

#include "app/command.h"
#include "app/crc32.h"
#include "app/path_check.h"
#include "app/points.h"
#include "app/wire_biquad.h"

#define WAVE_ONE_Q30 (1 << 30)

enum wire_status command_set_axis(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_set_axis_request set;
    (void)answer;
    wire_unpack_set_axis_request(&set, request->payload, request->size);
    struct loop_filter_config filter;
    if (set.axis >= AXES || set.mode >= WIRE_MODE_COUNT || set.kp_q24 < 0 || set.ki_ts_q32 < 0 ||
        set.kd_over_ts_q24 < 0 || set.d_alpha_q31 <= 0 || !loop_filter_of(set.filters, &filter))
        return WIRE_STATUS_BAD_VALUE;
    if (axis_mode_uses_tables(set.mode) && !device_tables(device, set.axis))
        return WIRE_STATUS_NO_MODEL;
    if (axis_mode_inverts(set.mode) && !device_compensation(device, set.axis))
        return WIRE_STATUS_NO_MODEL;
    struct axis_config *config = &device->control.config[set.axis];
    config->mode = set.mode;
    config->pid = (struct pid_config){set.kp_q24, set.ki_ts_q32, set.kd_over_ts_q24, set.d_alpha_q31};
    config->filter = filter;
    memset(&config->path, 0, sizeof config->path); /* its unit may have changed with the mode */
    memset(&config->point, 0, sizeof config->point);
    config->enter_ticks = config->leave_ticks = 0;
    axis_set_reference(config, &device->model_of[set.axis], &device->control.axis[set.axis]);
    device_wake(device, set.axis);
    device->control.path_mask &= ~(1u << set.axis);
    return WIRE_STATUS_OK;
}

static void take_joins(struct axis_config *config, const struct segment *segment)
{
    config->path.flags = segment->path.flags;
    config->path.ticks = segment->path.ticks;
    config->enter_turn64 = segment->enter_turn64;
    config->leave_turn64 = segment->leave_turn64;
    config->enter_ticks = segment->enter_ticks;
    config->leave_ticks = segment->leave_ticks;
}

enum wire_status command_set_path(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_set_path_request set;
    wire_unpack_set_path_request(&set, request->payload, request->size);
    if (set.axis >= AXES || set.path >= WIRE_PATH_KIND_COUNT)
        return WIRE_STATUS_BAD_VALUE;
    struct segment segment = {.path = {.kind = set.path,
                                       .swing = set.swing,
                                       .offset = set.offset,
                                       .step_turn64 = set.step_turn64,
                                       .ticks = set.ticks}};
    struct axis_config *config = &device->control.config[set.axis];
    if (set.path == PATH_WAVE && device->control.points[set.axis].ring == POINTS_PLAYED)
        return WIRE_STATUS_BAD_VALUE; /* they have been played */
    enum wire_status status = path_check(device, set.axis, &segment);
    if (status != WIRE_STATUS_OK)
        return status;
    points_set(device, set.axis, &segment.path);
    config->path = segment.path;
    config->point = segment.point;
    take_joins(config, &segment);
    axis_set_reference(config, &device->model_of[set.axis], &device->control.axis[set.axis]);
    device_wake(device, set.axis);
    device->control.path_mask |= 1u << set.axis;
    struct wire_set_path_reply reply = {.inverse_gain_q28 = segment.point.inverse_gain_q28,
                                        .lead_turn32 = segment.point.lead_turn32};
    wire_pack_set_path_reply(&reply, answer->payload, answer->size);
    return WIRE_STATUS_OK;
}

enum wire_status command_set_joins(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_set_joins_request set;
    wire_unpack_set_joins_request(&set, request->payload, request->size);
    if (set.axis >= AXES || !is_in(device->control.path_mask, set.axis))
        return WIRE_STATUS_BAD_VALUE;
    struct axis_config *config = &device->control.config[set.axis];
    struct segment segment = {.path = config->path, .enter_ticks = set.enter_ticks, .leave_ticks = set.leave_ticks};
    segment.path.flags = set.flags;
    enum wire_status status = path_check(device, set.axis, &segment); /* no tick changes a path that is not started */
    device_lock(device);
    answer->tick = device->control.tick;
    if (status == WIRE_STATUS_OK)
        take_joins(config, &segment);
    device_unlock(device);
    return status;
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
    answer->tick = device->control.tick;
    const bool used = is_in(points_waves_used(device), chunk.axis);
    if (!used) {
        device->wave_mask &= ~(1u << chunk.axis); /* incomplete until its commit: no path of it can begin meanwhile */
        device->control.points[chunk.axis].ring = POINTS_NO_RING;
        device_link_models(device);
    }
    device_unlock(device);
    if (used)
        return WIRE_STATUS_BUSY;
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
    if (!path_check_learned_with(device, commit.model_crc))
        return WIRE_STATUS_LEARNED_FOR_OTHER;
    const uint32_t steepest_q30 = motion_steepest_q30(device->waves_q30[commit.axis]);
    device_lock(device);
    answer->tick = device->control.tick;
    const bool used = is_in(points_waves_used(device), commit.axis);
    if (!used) {
        device->wave_steepest_q30[commit.axis] = steepest_q30;
        device->wave_for[commit.axis] = (struct learned_for){commit.model_crc, commit.path_crc};
        device->wave_mask |= 1u << commit.axis;
        device_link_models(device);
    }
    device_unlock(device);
    return used ? WIRE_STATUS_BUSY : WIRE_STATUS_OK;
}
