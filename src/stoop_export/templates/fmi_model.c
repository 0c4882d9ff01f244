/* Equations of motion and instruments of a vehicle, made by stoop export. SI units and radians; body axes forward, right,
   down. Integrated by Runge-Kutta of order four; inputs are linear over a communication step, by their rates. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* EQUATIONS */
/* Variables by value reference: time, largest step, parameters, start of the states, inputs, their rates, states, outputs. */
enum { PARAMETERS = 2, START = PARAMETERS + NP, INPUTS = START + NX, RATES = INPUTS + NU, STATES = RATES + NU,
       OUTPUTS = STATES + NX, COUNT = OUTPUTS + NY };
enum { OK = 0, ERROR = 3 };

typedef struct {
    double value[COUNT];
    bool running; /* after the initialization: the states are no longer those of the start */
} Model;

static const double DEFAULTS[] = { /* DEFAULTS */ };

static void refresh(Model *m)
{
    double rates[NX + 1];
    double *v = m->value;
    if (!m->running)
        memcpy(v + STATES, v + START, NX * sizeof(double));
    equations(v + STATES, v + INPUTS, v + RATES, v + PARAMETERS, rates, v + OUTPUTS);
}

static void reset(Model *m)
{
    memset(m, 0, sizeof(Model));
    memcpy(m->value, DEFAULTS, sizeof(DEFAULTS));
}

static int get(Model *m, const uint32_t *references, size_t count, double *values)
{
    refresh(m);
    for (size_t i = 0; i < count; i++) {
        if (references[i] >= COUNT)
            return ERROR;
        values[i] = m->value[references[i]];
    }
    return OK;
}

static int set(Model *m, const uint32_t *references, size_t count, const double *values)
{
    for (size_t i = 0; i < count; i++) {
        const uint32_t k = references[i];
        if (k < 1 || k >= STATES || (m->running && k < INPUTS))
            return ERROR;
        m->value[k] = values[i];
    }
    return OK;
}

static void slope(Model *m, const double *x, const double *k, double h, const double *u, double *out)
{
    double moved[NX + 1], readings[NY + 1];
    for (int i = 0; i < NX; i++)
        moved[i] = x[i] + h * k[i];
    equations(moved, u, m->value + RATES, m->value + PARAMETERS, out, readings);
}

static int advance(Model *m, double time, double duration)
{
    double *v = m->value, *x = v + STATES, k1[NX + 1], k2[NX + 1], k3[NX + 1], k4[NX + 1];
    double begin[NU + 1], middle[NU + 1], end[NU + 1];
    const double wanted = ceil(duration / v[1] - 1e-9);
    if (!m->running || !(duration >= 0.0) || !(v[1] > 0.0) || wanted > 1e9)
        return ERROR;
    const long steps = wanted < 1.0 ? 1 : (long)wanted;
    const double h = duration / (double)steps;
    memset(k1, 0, sizeof k1);
    memcpy(begin, v + INPUTS, NU * sizeof(double));
    for (long step = 0; step < steps; step++) {
        for (int i = 0; i < NU; i++) {
            end[i] = begin[i] + v[RATES + i] * h;
            middle[i] = 0.5 * (begin[i] + end[i]);
        }
        slope(m, x, k1, 0.0, begin, k1);
        slope(m, x, k1, 0.5 * h, middle, k2);
        slope(m, x, k2, 0.5 * h, middle, k3);
        slope(m, x, k3, h, end, k4);
        for (int i = 0; i < NX; i++)
            x[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        memcpy(begin, end, NU * sizeof(double));
    }
    memcpy(v + INPUTS, begin, NU * sizeof(double));
    v[0] = time + duration;
    for (int i = 0; i < NX; i++)
        if (!isfinite(x[i]))
            return ERROR;
    return OK;
}
