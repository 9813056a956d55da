/* Where the trigger outputs pulse. */
#include "app/command.h"

/* Places in an LSB. 2^24 (256 um) away from the origin one is within 2^-8 of a distance of where it should be. */
static uint32_t places_q32(uint32_t distance)
{
    return UINT32_MAX / distance;
}

static bool is_sane(const struct wire_trigger_set_request *set)
{
    if (set->output >= TRIGGERS || set->mark >= WIRE_MARK_COUNT || set->axis >= AXES || set->rising > 1)
        return false;
    if (set->mark == TRIGGER_WAY)
        return set->every >= TRIGGER_WAY_LEAST;
    return set->every != 0 || (set->mark != TRIGGER_TURN && set->mark != TRIGGER_TIME);
}

enum wire_status command_trigger_set(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_trigger_set_request set;
    (void)answer;
    wire_unpack_trigger_set_request(&set, request->payload, request->size);
    if (!is_sane(&set))
        return WIRE_STATUS_BAD_VALUE;
    const struct trigger_config config = {
        .mark = set.mark,
        .axis = set.axis,
        .rising = set.rising,
        .every = set.mark == TRIGGER_WAY ? places_q32(set.every) : set.every,
        .origin = set.origin,
    };
    trigger_set(&device->control.trigger[set.output], &config, &device->control.axis[set.axis]);
    return WIRE_STATUS_OK;
}
