/* Waveforms whose points come while they are played.
 *
 * The memory of an axis' waveform is then a ring: point n lies at n modulo WAVE_POINTS, the path begins at point 0, and
 * a tick plays it as it plays any waveform. What makes it safe is the length of the path, which is never longer than
 * the points suffice for, its join to a hold included: it grows as points come. So a host that is late ends the path
 * as its end would, without a kick, and a tick does nothing for it. */
#ifndef PHASELEAD_APP_POINTS_H
#define PHASELEAD_APP_POINTS_H

#include "app/device.h"

#define POINTS_LOG2_MOST 8 /* a point every 51 ms: the ring then lasts for 52 s */

/* These axes' waveforms are rings from now on. */
void points_begin(struct device *device, uint32_t mask, const struct points_ring *ring,
                  const uint32_t steepest_q30[AXES]);

/* Axes that play their waveform, leave it, or have it in their queue. */
uint32_t points_waves_used(const struct device *device);

/* A path of the ring that is set or queued has the length that its points suffice for. Not ok: they do not suffice for
 * anything, or the path does not fit the ring. */
enum wire_status points_fit(const struct device *device, unsigned axis, struct segment *segment);

/* This path is set, or queued: when it plays the ring, nothing else can. */
void points_set(struct device *device, unsigned axis, const struct path_config *path);

/* The path of the ring that waits or is played; NULL when there is none. */
struct path_config *points_path(struct device *device, unsigned axis);

/* Ticks until that path ends; 0: none is played. */
uint64_t points_left_ticks(const struct device *device, unsigned axis);

/* How many more points there is room for. */
uint32_t points_room(struct device *device, unsigned axis);

/* `count` more have been put into the ring: the path becomes longer, up to `length_ticks` when that is not 0. */
void points_come(struct device *device, unsigned axis, uint32_t count, uint64_t length_ticks);

static inline bool points_are_a_ring(const struct device *device, unsigned axis)
{
    return device->control.points[axis].ring != POINTS_NO_RING;
}

#endif
