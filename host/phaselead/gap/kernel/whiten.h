/* Whitening many columns of one record at once, in doubles; see host/phaselead/gap/noise.py for the model. */
#ifndef PHASELEAD_GAP_WHITEN_H
#define PHASELEAD_GAP_WHITEN_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define PHASELEAD_EXPORT __declspec(dllexport)
#else
#define PHASELEAD_EXPORT __attribute__((visibility("default")))
#endif

struct gap_whitener {
    size_t n_sensor;      /* taps of the sensor's filter */
    const double *sensor; /* in units of the innovations' deviation */
    const double *phi;    /* (n): how much of the misfit lasts from one row to the next */
    const double *diag;   /* (n): Cholesky factor of the covariance of e_k - phi_k e_{k-1}, */
    const double *below;  /* (n): below[k] stands right of diag[k + 1] */
    size_t n_rest;        /* taps of the filter for rows in motion */
    const double *rest;
    const uint8_t *moving; /* (n) */
};

/* Rows of k columns: values (n, k) -> white (n, k), row after row. `steps` (n, k) is scratch and holds the innovations
 * before the filter for rows in motion. Rows that lack the sensor filter's past are 0. */
PHASELEAD_EXPORT void gap_whiten(const struct gap_whitener *w, size_t n, size_t k, const double *values, double *steps,
                                 double *white);

/* Lower Cholesky factor, diag (n) and below (n) as above, of the covariance of n_k - phi_k n_{k-1} + w_k, where n is
 * white of unit variance, w_k has the variance grown[k], and the first row 1 + first. */
PHASELEAD_EXPORT void gap_differences_factor(size_t n, const double *phi, const double *grown, double first,
                                             double *diag, double *below);

#endif
