#include "app/model_slot.h"

#define AXES_OFFSET (WIRE_MODEL_SIZE - MODEL_AXES * WIRE_AXIS_MODEL_SIZE)

const struct wire_axis_model *model_axis(const struct model_slot *slot, unsigned axis, struct wire_axis_model *room)
{
    wire_unpack_axis_model(room, slot->blob + AXES_OFFSET + axis * WIRE_AXIS_MODEL_SIZE, WIRE_AXIS_MODEL_SIZE);
    return room;
}
