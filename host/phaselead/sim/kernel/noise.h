/* Gaussian numbers: xoshiro256++ (Blackman & Vigna 2019) seeded by splitmix64, shaped by a 256-layer ziggurat
 * (Marsaglia & Tsang 2000). Same seed, same bits. */
#ifndef PHASELEAD_SIM_NOISE_H
#define PHASELEAD_SIM_NOISE_H

#include <stdint.h>

#define ZIGGURAT_LAYERS 256

struct ziggurat { /* layer edges and the density there; shared by all generators */
    double x[ZIGGURAT_LAYERS + 1];
    double density[ZIGGURAT_LAYERS + 1];
};

struct noise {
    uint64_t s[4];
};

void ziggurat_fill(struct ziggurat *table);
void noise_seed(struct noise *noise, uint64_t seed, uint64_t stream);

/* The rare way out of the ziggurat: a layer's edge or the tail. */
double noise_slow(struct noise *noise, const struct ziggurat *table, unsigned layer, double x);

static inline uint64_t noise_bits(struct noise *noise)
{
    uint64_t *s = noise->s;
    uint64_t sum = s[0] + s[3];
    uint64_t result = ((sum << 23) | (sum >> 41)) + s[0];
    uint64_t t = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = (s[3] << 45) | (s[3] >> 19);
    return result;
}

/* Zero mean, unit variance. */
static inline double noise_gaussian(struct noise *noise, const struct ziggurat *table)
{
    uint64_t bits = noise_bits(noise);
    unsigned layer = (unsigned)(bits & (ZIGGURAT_LAYERS - 1));
    double unit = (double)((int64_t)bits >> 11) * 0x1p-52; /* -1 .. 1 */
    double x = unit * table->x[layer];
    if ((x < 0 ? -x : x) < table->x[layer + 1])
        return x;
    return noise_slow(noise, table, layer, x);
}

#endif
