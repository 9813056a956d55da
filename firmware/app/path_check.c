#include "app/path_check.h"

#include "app/crc32.h"
#include "app/points.h"
#include "core/fixed.h"

#define HALF_TURN64 ((uint64_t)1 << 63)

/* turns per tick x ticks per second, to nearest, so that the ends of the rectangle are inside it. */
static int32_t frequency_q16(uint64_t step_turn64)
{
    uint64_t high = (step_turn64 >> 32) * TICK_RATE_HZ;
    uint64_t low = (step_turn64 & UINT32_MAX) * TICK_RATE_HZ >> 32;
    return (int32_t)((high + low + (1u << 15)) >> 16);
}

static bool path_is_sane(const struct path_config *path)
{
    const bool from_here = (path->flags & PATH_FROM_HERE) != 0;
    if ((path->flags & ~(uint32_t)(PATH_FROM_HERE | PATH_MORE)) != 0 || (from_here && path_is_periodic(path)))
        return false;
    if (path->kind == PATH_HOLD)
        return true;
    if (path_is_periodic(path) && path->swing < 0)
        return false;
    return path->step_turn64 != 0 && path->step_turn64 < HALF_TURN64;
}

static bool within(const struct path_span *span, int64_t least, int64_t most)
{
    return span->low >= least && span->high <= most;
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

static enum wire_status check_tables(const struct device *device, unsigned axis, const struct path_config *path,
                                     const struct path_span *span_q16, struct feedforward_point *point)
{
    const struct feedforward_tables *tables = device_tables(device, axis);
    const struct output_config *output = &device->control.config[axis].output;
    bool periodic = path_is_periodic(path);
    if (!tables)
        return WIRE_STATUS_NO_MODEL;
    if (periodic && !feedforward_lookup(tables, path->swing, frequency_q16(path->step_turn64), point))
        return WIRE_STATUS_OUTSIDE_RECTANGLE;
    if (!periodic && !within(span_q16, -(int64_t)tables->range_max_q16, tables->range_max_q16))
        return WIRE_STATUS_OUTSIDE_RECTANGLE;
    int64_t low_q24 = static_u_q24(tables, point, periodic, span_q16->low);
    int64_t high_q24 = static_u_q24(tables, point, periodic, span_q16->high);
    const struct path_span span_q24 = {low_q24, high_q24};
    return within(&span_q24, output->u_min_q24, output->u_max_q24) ? WIRE_STATUS_OK : WIRE_STATUS_OUTSIDE_LIMITS;
}

/* step x preview; whole turns wrap around. */
static int32_t preview_turn32(const struct compensation *compensation, uint64_t step_turn64)
{
    uint64_t ticks_q16 = compensation->preview_ticks_q16;
    uint64_t lead_turn64 = ((step_turn64 >> 32) * ticks_q16 << 16) + ((step_turn64 & UINT32_MAX) * ticks_q16 >> 16);
    return (int32_t)(uint32_t)((lead_turn64 + (1u << 31)) >> 32);
}

static enum wire_status check_inverse(const struct device *device, unsigned axis, const struct path_config *path,
                                      const struct path_span *span_q16, struct feedforward_point *point)
{
    const struct compensation *compensation = device_compensation(device, axis);
    if (!compensation)
        return WIRE_STATUS_NO_MODEL;
    const struct model_reach *reach = &model_store_active(&device->models)->reach[axis];
    if (path_is_periodic(path))
        point->lead_turn32 = preview_turn32(compensation, path->step_turn64);
    return within(span_q16, reach->low_q16, reach->high_q16) ? WIRE_STATUS_OK : WIRE_STATUS_OUTSIDE_LIMITS;
}

/* The values that a path of this axis may have. */
static struct path_span range_of(const struct device *device, unsigned axis)
{
    const struct axis_config *config = &device->control.config[axis];
    bool saturated = false;
    if (config->mode == AXIS_OPEN)
        return (struct path_span){config->output.u_min_q24, config->output.u_max_q24};
    const int32_t least = converter_position_q16(&config->converter, (uint16_t)config->code_min, &saturated);
    const int32_t most = converter_position_q16(&config->converter, (uint16_t)config->code_max, &saturated);
    return (struct path_span){least, most};
}

struct path_span path_check_span(const struct path_config *path, const struct path_span *here)
{
    if ((path->flags & PATH_FROM_HERE) == 0)
        return path_span(path);
    struct path_span span = *here;
    if (path->kind != PATH_MOVE)
        return span;
    span.low = path->swing < span.low ? path->swing : span.low;
    span.high = path->swing > span.high ? path->swing : span.high;
    return span;
}

static enum wire_status check_range(const struct device *device, unsigned axis, const struct path_config *path,
                                    struct feedforward_point *point)
{
    const struct axis_config *config = &device->control.config[axis];
    const struct path_span range = range_of(device, axis);
    struct path_span span = path_span(path);
    if ((path->flags & PATH_FROM_HERE) != 0) { /* where the axis is, it may go on from; what counts is the target */
        if (path->kind != PATH_MOVE)
            return WIRE_STATUS_OK;
        span = (struct path_span){path->swing, path->swing};
    }
    if (!within(&span, range.low, range.high))
        return WIRE_STATUS_OUTSIDE_LIMITS;
    if (axis_mode_inverts(config->mode))
        return check_inverse(device, axis, path, &span, point);
    return axis_mode_uses_tables(config->mode) ? check_tables(device, axis, path, &span, point) : WIRE_STATUS_OK;
}

static uint64_t per_join_turn64(uint32_t ticks)
{
    return ticks > 1 ? UINT64_MAX / ticks + 1 : UINT64_MAX;
}

/* As WAVE_COMMIT's `path_crc` says. */
static uint32_t path_crc(enum axis_mode mode, const struct path_config *path)
{
    const uint8_t mode_byte = (uint8_t)mode;
    uint32_t crc = crc32(0, &mode_byte, sizeof mode_byte);
    crc = crc32(crc, (const uint8_t *)&path->swing, sizeof path->swing);
    crc = crc32(crc, (const uint8_t *)&path->offset, sizeof path->offset);
    return crc32(crc, (const uint8_t *)&path->step_turn64, sizeof path->step_turn64);
}

bool path_check_learned_with(const struct device *device, uint32_t model_crc)
{
    const struct model_slot *slot = model_store_active(&device->models);
    return model_crc == 0 || (slot && slot->crc == model_crc);
}

bool path_check_learned_for(const struct device *device, unsigned axis, const struct path_config *path)
{
    const struct learned_for *learned = &device->wave_for[axis];
    if (path->kind != PATH_WAVE)
        return true;
    if (!path_check_learned_with(device, learned->model_crc))
        return false;
    return learned->path_crc == 0 || learned->path_crc == path_crc(device->control.config[axis].mode, path);
}

enum wire_status path_check(const struct device *device, unsigned axis, struct segment *segment)
{
    if (device->control.config[axis].mode == AXIS_IDLE)
        return WIRE_STATUS_MODE_UNSUPPORTED; /* the path's unit depends on the mode */
    if (!path_is_sane(&segment->path) || (segment->path.kind == PATH_WAVE && !device_wave_q30(device, axis)))
        return WIRE_STATUS_BAD_VALUE;
    if (!path_check_learned_for(device, axis, &segment->path))
        return WIRE_STATUS_LEARNED_FOR_OTHER;
    segment->point = (struct feedforward_point){0, 0};
    segment->enter_turn64 = per_join_turn64(segment->enter_ticks);
    segment->leave_turn64 = per_join_turn64(segment->leave_ticks);
    const enum wire_status status = check_range(device, axis, &segment->path, &segment->point);
    if (status != WIRE_STATUS_OK || segment->path.kind != PATH_WAVE || !points_are_a_ring(device, axis))
        return status;
    return points_fit(device, axis, segment);
}
