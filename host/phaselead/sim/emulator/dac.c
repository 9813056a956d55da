/* An AD5764R behind SPI2, at the level of its frames and pins. Times are worst cases: docs/emulation.md has their
 * sources.
 */
#include "board.h"

#include <string.h>

#define CHANNELS 4
#define SDO_VALID_NS 25     /* from the rising edge of SCLK */
#define MASTER_SETUP_NS 7   /* of the processor's input, before the falling edge */
#define LATCH_SETUP_NS 1700 /* from the last SYNC to LDAC */

static struct {
    uint16_t data[CHANNELS], latched[CHANNELS]; /* two's complement */
    uint16_t gain[CHANNELS], fine[CHANNELS], offset[CHANNELS];
    uint32_t shift, answer;
    unsigned bits;
    bool selected, cleared;
    bool is_latched; /* in this tick already: what came later waits for the next one */
} dac;

static uint16_t *register_of(uint32_t frame, unsigned channel)
{
    switch (frame >> 19 & 7u) {
    case 2:
        return &dac.data[channel];
    case 3:
        return &dac.gain[channel];
    case 4:
        return &dac.fine[channel];
    case 5:
        return &dac.offset[channel];
    default:
        return NULL;
    }
}

static void latch(void)
{
    if (timer_runs() && !dac.cleared && !injected.dac_silent && !dac.is_latched)
        memcpy(dac.latched, dac.data, sizeof dac.latched);
    dac.is_latched = true;
}

static void obey(uint32_t frame)
{
    unsigned channel = frame >> 16 & 7u;
    dac.answer = 0;
    if (frame >> 23 & 1u) {
        uint16_t *from = channel < CHANNELS ? register_of(frame, channel) : NULL;
        dac.answer = from ? *from : 0;
        return;
    }
    if (board.delays && timer_runs() && now_ns() > timer_latch_ns() - LATCH_SETUP_NS)
        latch();
    for (unsigned i = 0; i < CHANNELS; i++) {
        uint16_t *to = register_of(frame, i);
        if (to && (channel == 4 || channel == i))
            *to = (uint16_t)frame;
    }
}

/* A frame of other than 24 bits is none. */
void dac_pins(bool selected, bool cleared)
{
    if (selected && !dac.selected) {
        dac.bits = 0;
        dac.shift = dac.answer;
    } else if (!selected && dac.selected && dac.bits == 24 && !injected.dac_silent) {
        obey(dac.shift);
    }
    dac.selected = selected;
    if (cleared && !dac.cleared) {
        memset(dac.data, 0, sizeof dac.data);
        memset(dac.latched, 0, sizeof dac.latched);
    }
    dac.cleared = cleared;
}

/* SDO that is not valid in time still shows the bit before. */
uint32_t dac_exchange(uint32_t byte, uint64_t clock_Hz)
{
    if (!dac.selected || injected.dac_silent)
        return 0xFF; /* SDO is pulled up */
    bool late = board.delays && 500000000u / clock_Hz < SDO_VALID_NS + MASTER_SETUP_NS;
    uint32_t out = (late ? dac.shift >> 17 : dac.shift >> 16) & 0xFFu;
    dac.shift = (dac.shift << 8 | (byte & 0xFFu)) & 0xFFFFFFu;
    dac.bits += 8;
    return out;
}

/* LDAC has fallen in every tick that TIM2 drove; without it the outputs stay. Codes as the model file counts them. */
void dac_output(uint16_t codes[AXES])
{
    latch();
    dac.is_latched = false;
    for (unsigned axis = 0; axis < AXES; axis++) {
        if (dac.latched[axis] != 0 && dac.gain[axis] != 1)
            board_broken("the DAC drives axis %u without its range set", axis);
        codes[axis] = dac.latched[axis] ^ 0x8000u;
    }
}

void dac_power_on(void)
{
    memset(&dac, 0, sizeof dac);
}
