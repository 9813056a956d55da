#include "app/triggers.h"

static bool pulses(struct control *control, struct trigger *trigger)
{
    const unsigned axis = trigger->config.axis;
    return trigger_step(trigger, &control->config[axis], &control->axis[axis]);
}

/* One after the other: a loop would be three times the code, made by a compiler that unrolls it. */
void triggers_set_outputs(struct device *device)
{
    struct control *control = &device->control;
    const bool first = pulses(control, &control->trigger[0]);
    const bool second = pulses(control, &control->trigger[1]);
    const bool third = pulses(control, &control->trigger[2]);
    control->pulsing = (first ? 1u : 0u) | (second ? 2u : 0u) | (third ? 4u : 0u);
}
