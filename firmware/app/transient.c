#include "app/transient.h"

#include <string.h>

#include "core/fixed.h"

#define Q24_TO_Q11 13
#define ENTRY_SIZE sizeof(struct transient_entry)

static void wait(struct transient *transient)
{
    transient->state = WIRE_TRANSIENT_STATE_WAITING;
    transient->cause = WIRE_TRIGGER_FAULT;
    transient->skip = 0;
    transient->next = transient->count = 0;
    transient->before_is_known = false;
}

bool transient_arm(struct transient *transient, const struct wire_transient_arm_request *trigger)
{
    if (trigger->trigger >= WIRE_TRIGGER_COUNT || trigger->axis >= TRANSIENT_AXES || trigger->decimation == 0 ||
        trigger->after > TRANSIENT_ENTRIES || trigger->falling > 1 ||
        (trigger->trigger == WIRE_TRIGGER_THRESHOLD && trigger->channel != WIRE_CHANNEL_REFERENCE &&
         trigger->channel != WIRE_CHANNEL_ADC && trigger->channel != WIRE_CHANNEL_DAC))
        return false;
    transient->trigger = *trigger;
    wait(transient);
    return true;
}

void transient_reset(struct transient *transient)
{
    const struct wire_transient_arm_request fault = {
        .trigger = WIRE_TRIGGER_FAULT, .decimation = 1, .after = TRANSIENT_DEFAULT_AFTER};
    transient_arm(transient, &fault);
}

void transient_arm_again(struct transient *transient)
{
    if (transient->state == WIRE_TRANSIENT_STATE_FROZEN)
        wait(transient);
}

void transient_trigger(struct transient *transient, enum wire_trigger cause, uint64_t tick,
                       const struct axis_config config[TRANSIENT_AXES])
{
    if (transient->state != WIRE_TRANSIENT_STATE_WAITING ||
        (cause != WIRE_TRIGGER_FAULT && cause != transient->trigger.trigger))
        return;
    transient->state = WIRE_TRANSIENT_STATE_TRIGGERED;
    transient->cause = (uint8_t)cause;
    transient->trigger_tick = tick;
    transient->left = transient->trigger.after;
    for (unsigned axis = 0; axis < TRANSIENT_AXES; axis++)
        transient->modes[axis] = (uint8_t)config[axis].mode;
}

static int32_t watched(const struct transient *transient, const uint16_t adc_codes[TRANSIENT_AXES],
                       const struct axis_trace traces[TRANSIENT_AXES])
{
    const unsigned axis = transient->trigger.axis;
    if (transient->trigger.channel == WIRE_CHANNEL_ADC)
        return adc_codes[axis];
    return transient->trigger.channel == WIRE_CHANNEL_DAC ? traces[axis].dac_code : traces[axis].reference;
}

/* From one side of the level to the other, or onto it. */
static bool crosses(struct transient *transient, int32_t value)
{
    const int32_t level = transient->trigger.level, before = transient->before;
    const bool known = transient->before_is_known;
    transient->before = value;
    transient->before_is_known = true;
    return known && (transient->trigger.falling ? before > level && value <= level : before < level && value >= level);
}

static void put(struct transient *transient, uint64_t tick, const uint16_t adc_codes[TRANSIENT_AXES],
                const struct axis_trace traces[TRANSIENT_AXES])
{
    struct transient_entry *entry = &transient->entries[transient->next];
    transient->next = transient->next + 1 == TRANSIENT_ENTRIES ? 0 : transient->next + 1;
    transient->count += transient->count < TRANSIENT_ENTRIES;
    entry->tick = (uint32_t)tick;
    for (unsigned axis = 0; axis < TRANSIENT_AXES; axis++)
        entry->axis[axis] = (struct transient_axis){
            .reference = traces[axis].reference,
            .adc_code = adc_codes[axis],
            .dac_code = traces[axis].dac_code,
            .feedforward_q11 = sat_i16(round_shift_i32(traces[axis].feedforward_q24, Q24_TO_Q11)),
            .feedback_q11 = sat_i16(round_shift_i32(traces[axis].feedback_q24, Q24_TO_Q11))};
}

void transient_tick(struct transient *transient, uint64_t tick, const uint16_t adc_codes[TRANSIENT_AXES],
                    const struct axis_trace traces[TRANSIENT_AXES], const struct axis_config config[TRANSIENT_AXES])
{
    if (transient->state == WIRE_TRANSIENT_STATE_FROZEN)
        return;
    if (transient->trigger.trigger == WIRE_TRIGGER_THRESHOLD &&
        crosses(transient, watched(transient, adc_codes, traces)))
        transient_trigger(transient, WIRE_TRIGGER_THRESHOLD, tick, config);
    if (transient->skip > 0) {
        transient->skip--;
        return;
    }
    transient->skip = (uint16_t)(transient->trigger.decimation - 1);
    put(transient, tick, adc_codes, traces);
    if (transient->state != WIRE_TRANSIENT_STATE_TRIGGERED)
        return;
    if (transient->left == 0)
        transient->state = WIRE_TRANSIENT_STATE_FROZEN;
    transient->left--;
}

const uint8_t *transient_bytes(const struct transient *transient, uint32_t offset, size_t *size)
{
    const uint8_t *ring = (const uint8_t *)transient->entries;
    const size_t ring_size = sizeof transient->entries, filled = transient->count * ENTRY_SIZE;
    if (offset > filled)
        return NULL;
    size_t at = (transient->count < TRANSIENT_ENTRIES ? 0 : transient->next * ENTRY_SIZE) + offset;
    if (at >= ring_size)
        at -= ring_size;
    size_t left = filled - offset, together = ring_size - at;
    if (left > together)
        left = together;
    if (*size > left)
        *size = left;
    return ring + at;
}
