/* Commands that a random host sends: of every kind, most of them such that a device carries them out. */
#ifndef PHASELEAD_SOAK_RANDOM_COMMANDS_H
#define PHASELEAD_SOAK_RANDOM_COMMANDS_H

#include "random_host.h"

void send_random(struct random_host *host); /* any type, any payload of a size that suits it */
void send_mode_and_path(struct random_host *host);
void send_gains(struct random_host *host);
void send_marks(struct random_host *host);
void send_arm_and_start(struct random_host *host);
void send_model(struct random_host *host);
void send_wave(struct random_host *host);
void send_points(struct random_host *host); /* a ring of points, a path of it, and pieces that come or do not */
void send_limits(struct random_host *host);
void send_queue(struct random_host *host);
void send_joins_and_bounds(struct random_host *host);
void send_streams(struct random_host *host);
void send_confirm(struct random_host *host);
void send_update(struct random_host *host);

#endif
