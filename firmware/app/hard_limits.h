/* Hard limits of an axis: a model may be tighter, never looser. */
#ifndef PHASELEAD_APP_HARD_LIMITS_H
#define PHASELEAD_APP_HARD_LIMITS_H

#include "app/wire.h"
#include "core/axis.h"

/* They can be met: neither range is empty, and the output can move. */
bool hard_limits_are_sane(const struct wire_axis_limits *limits);

/* Of each limit of the configuration and the hard one, the tighter; the hard ones become volts by its converter.
 * Where they leave out 0 V, at which the output is from reset on, it cannot leave it. */
void hard_limits_apply(const struct wire_axis_limits *limits, struct axis_config *config);

/* Whether the output can leave 0 V, and this output and the safe value are within its limits. */
bool hard_limits_admit(const struct axis_config *config, int32_t u_q24);

#endif
