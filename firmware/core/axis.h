/* One axis, one tick: reference -> look-ahead -> feed-forward -> feedback -> limit -> DAC code. Pure: everything it
 * needs is in its arguments.
 *
 * Reference, look-ahead and feed-forward do not depend on the sample. So they are worked out in advance, after the
 * output of the tick before: axis_set_target() and, with the inverse, axis_invert(). With the sample come
 * axis_error_q16() and axis_step(), after the output axis_follow_output(). In between, the positions ahead and the
 * errors of all axes may be decoupled (decouple.h). */
#ifndef PHASELEAD_CORE_AXIS_H
#define PHASELEAD_CORE_AXIS_H

#include "core/axis_path.h"
#include "core/axis_state.h"

struct axis_trace { /* what a tick did, for the recorder */
    int32_t reference;
    int32_t feedforward_q24, feedback_q24;
    uint16_t dac_code;
    bool path_done; /* the path ended in this tick */
    bool inverted;  /* the inverse made the feed-forward */
    bool limited;   /* slew limit or clamp cut the output, or the inverse kept to the slew limit itself */
};

/* The axis begins its path in the next tick (drive becomes DRIVE_PATH), without a bump in its output: the integrator is
 * set so that the loop carries on from u_q24; the slew limit spreads what feed-forward alone would jump. */
void axis_start(struct axis_state *state);

/* For an axis that was given a path and does not follow it yet: its reference becomes the path's first value. */
void axis_set_reference(const struct axis_config *config, const struct axis_model *model, struct axis_state *state);

/* It follows its path, and the target of the next tick is not known yet. */
bool axis_needs_target(const struct axis_state *state);

/* Reference, look-ahead and feed-forward of the next tick; advances the path. For an axis that needs a target. True:
 * axis_invert() must follow and gives the feed-forward. */
bool axis_set_target(const struct axis_config *config, const struct axis_model *model, struct axis_state *state);

/* Feed-forward by the inverse: the voltage for target.ahead_q16, decoupled. */
void axis_invert(const struct axis_config *config, const struct axis_model *model, struct axis_state *state,
                 int32_t ahead_q16);

/* In a mode with feedback and without the inverse: adds the voltage that moves the axis by so much, by the model's
 * slope.
 */
void axis_lead_by(const struct axis_model *model, struct axis_state *state, int32_t way_q16);

/* This tick has feedback. */
bool axis_has_feedback(const struct axis_state *state);

/* Reference - position, for an axis with feedback. */
int32_t axis_error_q16(const struct axis_config *config, struct axis_state *state, uint16_t adc_code);

/* Feedback, limit and DAC code. The target is used up. True: the axis is at rest, another step would change nothing. */
bool axis_step(const struct axis_config *config, struct axis_state *state, int32_t error_q16, struct axis_trace *trace);

/* After the output, for an axis under feedback: whether it can still be believed. `error_q16` as axis_step() had it. */
enum watch_finding axis_watch(const struct axis_config *config, struct axis_state *state, uint16_t adc_code,
                              int32_t error_q16, const struct axis_trace *trace);

/* The same of an axis without feedback, by its sensor's codes alone. */
enum watch_finding axis_watch_codes(const struct axis_config *config, struct axis_state *state, uint16_t adc_code);

/* After the output, for an axis that follows its path in any mode: whether it is within the range it is held to. */
bool axis_watch_range(const struct axis_config *config, struct axis_state *state, uint16_t adc_code);

/* Counts the ticks in a row that the position has been within the window of the reference. */
void axis_watch_target(const struct axis_config *config, struct axis_state *state, uint16_t adc_code,
                       const struct axis_trace *trace);
bool axis_is_on_target(const struct axis_config *config, const struct axis_state *state);

/* Lets the memory of the inverse follow an output that the inverse did not make. True when the memory keeps changing
 * while the output stands still (creep). */
bool axis_follow_output(const struct axis_model *model, struct axis_state *state, const struct axis_trace *trace);

#endif
