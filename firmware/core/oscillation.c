#include "core/oscillation.h"

#include "core/fixed.h"

#define FIRST_PARTS 5u       /* ticks of the shortest block */
#define PARTS 2u             /* blocks of each scale in one of the next */
#define CORNER_SHIFT 3       /* 1 - exp(-2 pi f T) = 1/8: 106 Hz, where the band of a loop on a piezo stage ends */
#define MOST_Q16 (512 << 16) /* three stages, each at most doubling, times 8, fit 32 bits */
#define Q16_TO_Q6 10
#define MOST_LEFT_Q6 (63 << 6) /* its square, over the 160 ticks of the longest block, fits 32 bits */
/* Growth counts from a thirty-second of the limit on, so that noise does not begin it: energy / 2^10. */
#define LEAST_SHARE_LOG2 10

/* What is left after OSCILLATION_ORDER high-passes of the first order. */
static int32_t high_pass_q16(struct oscillation_filter *filter, int32_t x_q16)
{
    int32_t left_q16 = clamp_i32(x_q16, -MOST_Q16, MOST_Q16);
    for (unsigned i = 0; i < OSCILLATION_ORDER; i++) {
        left_q16 = sub_i32(left_q16, floor_shift_i32(filter->low[i], CORNER_SHIFT));
        filter->low[i] = add_i32(filter->low[i], left_q16);
    }
    return left_q16;
}

static uint32_t square_q12(int32_t value_q16)
{
    int32_t value_q6 = clamp_i32(round_shift_i32(value_q16, Q16_TO_Q6), -MOST_LEFT_Q6, MOST_LEFT_Q6);
    return (uint32_t)(value_q6 * value_q6);
}

/* It swings, and by more than `times` the reference. */
static bool is_beyond(const struct oscillation_block *block, uint32_t times)
{
    return block->sign_changed != 0 && block->energy / (times * times) >= block->reference_energy;
}

/* The block is over. `matters`: its energy at the limit; `ticks`: those it lasted. */
static bool judge(struct oscillation_block *block, uint32_t matters, uint32_t ticks)
{
    uint32_t share = matters >> LEAST_SHARE_LOG2, least = share > ticks ? share : ticks; /* the last place of q6 */
    uint32_t before = block->before > least ? block->before : least;
    if (!is_beyond(block, OSCILLATION_SENSITIVITY) || block->energy / 2 < before) {
        block->grown = block->weight = 0;
    } else if (block->grown < OSCILLATION_BLOCKS) {
        block->grown++;
        block->weight = (uint8_t)(block->weight + (block->energy / 4 >= before ? 2 : 1));
    }
    return (block->grown == OSCILLATION_BLOCKS || block->weight >= OSCILLATION_WEIGHT) && block->energy > matters;
}

static bool stays_loud(struct oscillation_state *state, const struct oscillation_block *block, uint32_t matters)
{
    const bool loud = is_beyond(block, OSCILLATION_QUALITY) && block->energy > matters;
    if (!loud || block->energy < state->loudest / 2) {
        state->loud = 0;
        state->loudest = 0;
    }
    if (!loud)
        return false;
    if (block->energy > state->loudest)
        state->loudest = block->energy;
    if (state->loud < OSCILLATION_LOUD)
        state->loud++;
    return state->loud == OSCILLATION_LOUD;
}

static void begin(struct oscillation_block *block)
{
    block->before = block->energy;
    block->energy = block->reference_energy = 0;
    block->sign_changed = block->parts = 0;
}

static void add(struct oscillation_state *state, unsigned scale, uint32_t energy, uint32_t reference_energy,
                uint8_t sign_changed)
{
    struct oscillation_block *to = &state->blocks[scale];
    to->energy += energy;
    to->reference_energy += reference_energy;
    to->sign_changed |= sign_changed;
    if (++to->parts == (scale == 0 ? FIRST_PARTS : PARTS))
        state->over |= (uint16_t)(1u << scale);
}

static bool judge_scale(struct oscillation_state *state, unsigned scale, int32_t limit_q16)
{
    struct oscillation_block *block = &state->blocks[scale];
    uint32_t ticks = FIRST_PARTS << scale, matters = square_q12(limit_q16) * ticks;
    bool found = judge(block, matters, ticks);
    if (scale + 1 < OSCILLATION_SCALES)
        add(state, scale + 1, block->energy, block->reference_energy, block->sign_changed);
    else if (stays_loud(state, block, matters))
        found = true;
    begin(block);
    return found;
}

/* Every block that is over. What one gives to the next scale is looked at a tick later: so the ends of the scales lie
 * in different ticks, but for the shortest and the longest. */
static bool judge_blocks(struct oscillation_state *state, int32_t limit_q16)
{
    const uint32_t over = state->over & ((1u << OSCILLATION_SCALES) - 1);
    if (over == 0)
        return false;
    const unsigned longest = 31u - leading_zeros_u32(over);
    state->over = (uint16_t)(over & ~(1u | 1u << longest));
    bool found = judge_scale(state, longest, limit_q16);
    if (longest != 0 && (over & 1u) != 0)
        found = judge_scale(state, 0, limit_q16) || found;
    return found;
}

static void prime(struct oscillation_state *state, int32_t error_q16, int32_t reference_q16)
{
    const uint8_t passed = state->blocks[0].parts;
    *state = (struct oscillation_state){.blocks[0].parts = passed, .primed = 1};
    state->error.low[0] = clamp_i32(error_q16, -MOST_Q16, MOST_Q16) * (1 << CORNER_SHIFT);
    state->reference.low[0] = clamp_i32(reference_q16, -MOST_Q16, MOST_Q16) * (1 << CORNER_SHIFT);
}

void oscillation_start(struct oscillation_state *state)
{
    state->primed = 0;
    state->blocks[0].parts = 0;
}

void oscillation_stagger(struct oscillation_state *state, unsigned ticks)
{
    state->blocks[0].parts = (uint8_t)(ticks % FIRST_PARTS);
}

bool oscillation_step(struct oscillation_state *state, int32_t limit_q16, int32_t error_q16, int32_t reference_q16)
{
    if (state->primed == 0)
        prime(state, error_q16, reference_q16);
    int32_t error = high_pass_q16(&state->error, error_q16);
    int32_t reference = high_pass_q16(&state->reference, reference_q16);
    add(state, 0, square_q12(error), square_q12(reference), (error ^ state->last_q16) < 0);
    state->last_q16 = error;
    return judge_blocks(state, limit_q16);
}
