/* An AD7606B behind SPI1, at the level of its words and pins. Times are worst cases: docs/emulation.md has their
 * sources.
 */
#include "board.h"

#include <string.h>

#define CONVERSION_NS 850
#define RESET_NS 3000    /* the shortest pulse that resets it as a whole */
#define SET_UP_NS 253000 /* until it converts again after that */
#define FRSTDATA_NS                                                                                                    \
    (30 + 22) /* from CS or the 16th edge to the pin, and through the pad and synchroniser of the port */

static struct {
    uint16_t words[AXES];
    unsigned next; /* channel that the next word brings */
    bool selected, converting, in_reset, fit, edge;
    int64_t selected_ns, first_out_ns, reset_ns, ready_ns;
    bool first_out;
} adc;

static bool answers(void)
{
    return adc.fit && !adc.in_reset && now_ns() >= adc.ready_ns && !injected.adc_silent;
}

bool adc_busy(void)
{
    if (injected.no_conversion)
        return false;
    return !answers() || now_ns() - timer_period_began_ns() < CONVERSION_NS;
}

/* BUSY has fallen since this was last asked for. */
bool adc_busy_fell(void)
{
    return adc.edge && adc.converting && !adc_busy();
}

void adc_forget_edge(void)
{
    adc.edge = false;
}

bool adc_frstdata(void)
{
    if (!answers() || !adc.selected)
        return false;
    if (!board.delays)
        return !adc.first_out;
    int64_t now = now_ns();
    return now >= adc.selected_ns + FRSTDATA_NS && (adc.next == 0 || now < adc.first_out_ns + FRSTDATA_NS);
}

void adc_pins(bool selected, bool reset)
{
    if (selected && !adc.selected) {
        adc.next = 0;
        adc.first_out = false;
        adc.selected_ns = now_ns();
    }
    adc.selected = selected;
    if (reset && !adc.in_reset)
        adc.reset_ns = now_ns();
    if (!reset && adc.in_reset && (!board.delays || now_ns() - adc.reset_ns >= RESET_NS)) {
        adc.fit = true;
        adc.ready_ns = board.delays ? now_ns() + SET_UP_NS : 0;
    }
    adc.in_reset = reset;
}

/* It has lost its wits, as after a glitch of its supply: a reset brings it back. */
void adc_confuse(void)
{
    adc.fit = false;
}

uint32_t adc_exchange(int64_t done_ns)
{
    if (!adc.selected || !answers() || adc_busy())
        return 0;
    unsigned channel = adc.next++;
    if (channel == 0)
        adc.first_out_ns = done_ns;
    return channel < AXES ? adc.words[channel] : 0;
}

/* The first word has been taken. */
void adc_word_taken(void)
{
    adc.first_out = adc.first_out || adc.next > 0;
}

void adc_convert(const uint16_t codes[AXES])
{
    adc.converting = answers() && !injected.no_conversion;
    if (!adc.converting)
        return;
    adc.edge = true;
    for (unsigned axis = 0; axis < AXES; axis++) {
        uint16_t code = injected.rail_mask >> axis & 1u ? 0xFFFFu : codes[axis];
        if (!(injected.frozen_mask >> axis & 1u))
            adc.words[axis] = code ^ 0x8000u;
    }
}

void adc_power_on(void)
{
    memset(&adc, 0, sizeof adc);
    adc.fit = !board.delays;
}
