/* One step of a stage that is put together from parts: what goes in runs straight from one substep to the next, what
 * comes out does so again. Voltages rest where 0 V at the converter puts them, positions are displacements from rest.
 */
#ifndef PHASELEAD_SIM_LINK_H
#define PHASELEAD_SIM_LINK_H

#include <stdbool.h>
#include <stdint.h>

#define LINK_POLES 48
#define LINK_NUMBERS 6
#define LINK_PLAYS 192
#define LINK_DEADZONES 32
#define LINK_RING_PLAYS 8
#define LINK_FADING 16
#define LINK_SUBSTEPS 8

enum link_kind {
    LINK_POLES_SUM = 1, /* number[0] x + sum Re(weight / (1 - s / pole)) x: lags, creep, leakage, modes */
    LINK_SLEW,          /* follows by at most number[0] a second, by a loop with the time constant number[1] */
    LINK_CLIP,          /* between number[0] and number[1] */
    LINK_OPERATOR,      /* the hysteresis operator: V in, um from rest out */
    LINK_SOFTENING,     /* kappa, X, tau, share of the mean that does not count, power of the level */
    LINK_BACKLASH,      /* number[0]: half the slack */
    LINK_FRICTION,      /* X, path to turn, onset in X/s, openings: growth per decade, loss to sliding, at any rate */
    LINK_STIFFNESS,     /* X, added at the whole range, of it: in proportion to the square and to the cube */
    LINK_CROSSOVER,     /* half the dead zone, tau of the loop around it */
};

struct link_parameters {
    uint32_t kind, poles;
    double number[LINK_NUMBERS];
    double pole_re[LINK_POLES], pole_im[LINK_POLES], weight_re[LINK_POLES], weight_im[LINK_POLES];
};

struct operator_parameters { /* a stage file's time view, with what can bend its loops */
    double gain_um_per_V;
    double play_r_V[LINK_PLAYS], play_w_um_per_V[LINK_PLAYS], play_start_V[LINK_PLAYS];
    double deadzone_d_V[LINK_DEADZONES], deadzone_s_um_per_V[LINK_DEADZONES];
    double low_V, high_V;                /* the voltages that bends and shares refer to */
    double field_bend;                   /* plays, dead zones and fading answer to a field that bends so far */
    double play_tilt, play_taper;        /* by which the first `uneven` plays weigh more at the top, less at the ends */
    double bend_um, skew_um, skew_reach; /* asymmetry: common curvature, one-sided width */
    double fading_r_V[LINK_FADING], fading_w_um_per_V[LINK_FADING], fading_start; /* friction that turns over a way */
    uint32_t plays, uneven, deadzones, fading;
};

struct operator_state {
    const struct operator_parameters *with;
    double play[LINK_PLAYS], square_play[LINK_RING_PLAYS];
    double turned[LINK_FADING], at_V; /* -1 to 1, at this field */
    double rest_um;
};

struct link {
    const struct link_parameters *with;
    struct operator_state *operator;                   /* of LINK_OPERATOR */
    double step_s, rest, in, out;                      /* `rest` of what goes in */
    double state_re[LINK_POLES], state_im[LINK_POLES]; /* of LINK_POLES_SUM */
    double decay_re[LINK_POLES], decay_im[LINK_POLES], behind_re[LINK_POLES], behind_im[LINK_POLES];
    double mean, level;                 /* of LINK_SOFTENING */
    double drive, held;                 /* of LINK_CROSSOVER: into the dead zone, and out of it */
    double recent[LINK_SUBSTEPS], drag; /* of LINK_FRICTION: what went in over the last tick, and the friction */
    unsigned now;
};

/* At rest under `rest` volts, or micrometres beyond the operator; link->out is then what rests behind it. False when
 * the parameters cannot be stepped. `operator` is the one of a LINK_OPERATOR. */
bool link_make(struct link *link, const struct link_parameters *from, struct operator_state *operator, double step_s,
               double rest);
double link_step(struct link *link, double x);

#endif
