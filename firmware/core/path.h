/* Reference paths: a value at now, and at any time or phase ahead of now.
 *
 * Values carry the unit of the swing: micrometres q16, or volts q24 when the axis runs open loop.
 *
 * Error against exact arithmetic, in LSB of the value, S = |swing|: sine 0.5 + 2 S/2^31, move 0.5 + 8 S/2^31, wave
 * 0.5 + (0.5 + d/2^23) S/2^30 where d is the step between two points in LSB of q30. At 250 um that is
 * 0.52, 0.57 and, for the steepest wave, 2.5.
 */
#ifndef PHASELEAD_CORE_PATH_H
#define PHASELEAD_CORE_PATH_H

#include <stdbool.h>
#include <stdint.h>

#define WAVE_POINTS 1024

enum path_kind { PATH_HOLD, PATH_SINE, PATH_WAVE, PATH_MOVE };

enum path_flag {
    PATH_FROM_HERE = 1, /* hold or move: begins where the path before is; the swing of a move is then its target */
    PATH_MORE = 2,      /* another path is to follow: it is a fault of the host's if none has come when this one ends */
    PATH_AT_TRIGGER = 4 /* in a queue: begins at an edge of the trigger input */
};

struct path_config {
    uint32_t kind;        /* enum path_kind */
    int32_t swing;        /* peak-to-peak; for a move: the way to go, signed */
    int32_t offset;       /* lowest value; for a hold or a move: where it starts */
    uint32_t flags;       /* enum path_flag */
    uint64_t step_turn64; /* sine, wave: turns per tick; move: 2^64 / duration */
    uint64_t ticks;       /* length; the value reached is then held; 0: for ever, a move until it arrives */
};

struct path_state {
    uint64_t phase_turn64; /* sine, wave: phase; move: fraction of the way's time */
    uint64_t elapsed;      /* ticks since the start */
    uint32_t running;      /* 0: not started, or done */
    uint32_t wait_ticks;   /* until it begins: meanwhile only a look ahead sees it move */
};

bool path_is_periodic(const struct path_config *config);

void path_start(struct path_state *state);

/* Value now. `wave_q30` holds WAVE_POINTS shares of the swing, 0 .. 2^30, joined by straight lines; a wave without
 * points stays at its offset. A sine is offset + swing (1 - cos 2 pi phase) / 2, a move offset + swing (10 s^3 - 15 s^4
 * + 6 s^5), which arrives at offset + swing exactly. A path not started has its first value, one that has ended the
 * value at its length (after n ticks the phase is n steps). */
int32_t path_now(const struct path_config *config, const struct path_state *state, const int32_t *wave_q30,
                 bool *saturated);

/* Value `lead_turn32` of a period ahead (sine, wave), or `lead_ticks_q16` ticks ahead (move, less what it still waits).
 * Never beyond the path's end for a move; a periodic path continues past its last tick so that the lead does not see
 * the end. Once the path is done: the held value. */
int32_t path_ahead(const struct path_config *config, const struct path_state *state, const int32_t *wave_q30,
                   int32_t lead_turn32, uint32_t lead_ticks_q16, bool *saturated);

/* What is left of a lead for a path that still waits. */
uint32_t path_lead_left_q16(const struct path_state *state, uint32_t lead_ticks_q16);

/* One tick on. Returns true at the tick in which the path ends. One that waits begins after its wait. */
bool path_advance(const struct path_config *config, struct path_state *state);

/* One tick on for a path that is being entered or left: a periodic one goes round without counting towards its length,
 * a hold stays, a move goes on to its end. */
void path_run_on(const struct path_config *config, struct path_state *state);

/* 10 s^3 - 15 s^4 + 6 s^5 at s = phase / 2^64: 0 .. 2^30, within 5 LSB. */
uint32_t path_least_jerk_q30(uint64_t phase_turn64);

/* phase + step x ticks, at most the end of the way, UINT64_MAX. */
uint64_t path_phase_ahead(uint64_t phase_turn64, uint64_t step_turn64, uint32_t ticks_q16);

#endif
