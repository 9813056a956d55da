#ifndef PHASELEAD_MODEL_LATE_VOLTAGE_H
#define PHASELEAD_MODEL_LATE_VOLTAGE_H

#include <stddef.h>

/* u at row k, late by `whole` rows and a `part` of one; it stood at `before` up to row -1. */
static inline double late_voltage(const double *u, double before, size_t k, size_t whole, double part)
{
    double at = k >= whole ? u[k - whole] : before;
    double earlier = k > whole ? u[k - whole - 1] : before;
    return at + part * (earlier - at);
}

#endif
