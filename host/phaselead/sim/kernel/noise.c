#include "noise.h"

#include <math.h>

/* Where the tail begins and the area of each layer, for 256 layers (Marsaglia & Tsang 2000). */
#define TAIL 3.6541528853610088
#define AREA 0.00492867323399

static uint64_t splitmix(uint64_t *state)
{
    uint64_t z = *state += 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

void noise_seed(struct noise *noise, uint64_t seed, uint64_t stream)
{
    uint64_t state = seed;
    state = splitmix(&state) ^ (stream * 0xD1B54A32D192ED03u);
    for (int i = 0; i < 4; i++)
        noise->s[i] = splitmix(&state);
}

void ziggurat_fill(struct ziggurat *table)
{
    double density = exp(-0.5 * TAIL * TAIL);
    table->x[0] = AREA / density; /* the bottom layer with its tail, as if it were a box */
    table->density[0] = density;
    table->x[1] = TAIL;
    table->density[1] = density;
    for (int i = 2; i < ZIGGURAT_LAYERS; i++) {
        table->density[i] = table->density[i - 1] + AREA / table->x[i - 1];
        table->x[i] = sqrt(-2 * log(table->density[i]));
    }
    table->x[ZIGGURAT_LAYERS] = 0;
    table->density[ZIGGURAT_LAYERS] = 1;
}

static double uniform(struct noise *noise)
{
    return ((double)(noise_bits(noise) >> 11) + 0.5) * 0x1p-53; /* never 0, never 1 */
}

static double tail(struct noise *noise, double sign)
{
    double x, y;
    do {
        x = -log(uniform(noise)) / TAIL;
        y = -log(uniform(noise));
    } while (2 * y < x * x);
    return sign * (TAIL + x);
}

double noise_slow(struct noise *noise, const struct ziggurat *table, unsigned layer, double x)
{
    if (layer == 0)
        return tail(noise, x < 0 ? -1 : 1);
    double between = table->density[layer] + uniform(noise) * (table->density[layer + 1] - table->density[layer]);
    if (between < exp(-0.5 * x * x))
        return x;
    return noise_gaussian(noise, table);
}
