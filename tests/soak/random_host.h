/* A host that says anything: bytes, frames, commands of every kind with sense and without, to a device whose power
 * fails, whose flash is bent and whose sensors and ports raise any fault. The same seed says the same.
 */
#ifndef PHASELEAD_SOAK_RANDOM_HOST_H
#define PHASELEAD_SOAK_RANDOM_HOST_H

#include "app/device.h"
#include "invariants.h"
#include "port/host/flash.h"

#define SESSION 0x1122334455667788u

struct random_host {
    uint64_t random;
    const uint8_t *input; /* NULL: none */
    size_t input_left;
    struct device device;
    struct host_flash flash;
    struct fault_log fault_log;
    struct invariants seen;
    uint16_t next_id;
    uint16_t codes[AXES]; /* of the sensors */
    struct control owned; /* by ticks: as it was when the last one, or the last lock, had ended */
    struct axis_model owned_models[AXES];
    uint32_t owned_rest;
    bool locked;
    uint8_t obeyed;  /* type of the last command that was carried out; 0: none since it was looked at */
    uint32_t rounds; /* since power came */
    uint64_t frames, replies, ticks;
    uint64_t done_of[WIRE_REPLY_BIT]; /* commands that were carried out, by number */
    uint64_t ticks_in[WIRE_STATE_COUNT], faults_of[WIRE_FAULT_COUNT];
    uint64_t path_ticks_in[WIRE_MODE_COUNT];    /* of all axes that follow a path */
    uint64_t filter_ticks[1u << LOOP_SECTIONS]; /* of those in closed loop, by the sections in use */
    uint64_t gains_under_way;                   /* set with both sections on an axis in closed loop */
};

/* What it does is chosen by the bytes of an input, NULL: by the seed alone, as sensors and line always are. */
void random_host_begin(struct random_host *host, uint64_t seed, const uint8_t *input, size_t size);

/* Says or does one thing, and lets a few ticks pass. The invariants are checked after every tick and every command. */
void random_host_round(struct random_host *host);

/* A frame with this command, now and then the one before once more, or with a bit flipped. */
void random_host_send(struct random_host *host, uint8_t type, uint64_t session, const uint8_t *payload, size_t size);

uint64_t random_bits(struct random_host *host);
uint32_t below(struct random_host *host, uint32_t limit); /* 0 of 0 */
uint64_t random_value(struct random_host *host);          /* at which code breaks, or in between */
void fill(struct random_host *host, uint8_t *to, size_t size);

#endif
