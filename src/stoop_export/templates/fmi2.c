/* Functional Mock-up Interface 2.0, co-simulation. */
typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*free)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const categories[])
{
    (void)c; (void)on; (void)n; (void)categories;
    return OK;
}

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *place, const Callbacks *functions,
                             int visible, int logging)
{
    (void)name; (void)place; (void)functions; (void)visible; (void)logging;
    if (type != 1 || guid == NULL || strcmp(guid, TOKEN) != 0)
        return NULL;
    Model *m = malloc(sizeof(Model));
    if (m != NULL)
        reset(m);
    return m;
}

EXPORT void fmi2FreeInstance(void *c) { free(c); }
EXPORT int fmi2SetupExperiment(void *c, int tolerant, double tolerance, double start, int stops, double stop)
{
    (void)tolerant; (void)tolerance; (void)stops; (void)stop;
    ((Model *)c)->value[0] = start;
    return OK;
}
EXPORT int fmi2EnterInitializationMode(void *c) { (void)c; return OK; }
EXPORT int fmi2ExitInitializationMode(void *c)
{
    refresh(c);
    ((Model *)c)->running = true;
    return OK;
}
EXPORT int fmi2Terminate(void *c) { (void)c; return OK; }
EXPORT int fmi2Reset(void *c) { reset(c); return OK; }

EXPORT int fmi2GetReal(void *c, const unsigned vr[], size_t n, double value[]) { return get(c, vr, n, value); }
EXPORT int fmi2SetReal(void *c, const unsigned vr[], size_t n, const double value[]) { return set(c, vr, n, value); }
#define NONE(NAME, TYPE) \
    EXPORT int fmi2Get##NAME(void *c, const unsigned vr[], size_t n, TYPE value[]) \
    { (void)c; (void)vr; (void)value; return n > 0 ? ERROR : OK; } \
    EXPORT int fmi2Set##NAME(void *c, const unsigned vr[], size_t n, const TYPE value[]) \
    { (void)c; (void)vr; (void)value; return n > 0 ? ERROR : OK; }
typedef const char *Text;
NONE(Integer, int)
NONE(Boolean, int)
NONE(String, Text)

EXPORT int fmi2GetFMUstate(void *c, void **state)
{
    if (*state == NULL)
        *state = malloc(sizeof(Model));
    if (*state == NULL)
        return ERROR;
    memcpy(*state, c, sizeof(Model));
    return OK;
}
EXPORT int fmi2SetFMUstate(void *c, void *state) { memcpy(c, state, sizeof(Model)); return OK; }
EXPORT int fmi2FreeFMUstate(void *c, void **state) { (void)c; free(*state); *state = NULL; return OK; }
EXPORT int fmi2SerializedFMUstateSize(void *c, void *state, size_t *size)
{
    (void)c; (void)state;
    *size = sizeof(Model);
    return OK;
}
EXPORT int fmi2SerializeFMUstate(void *c, void *state, char bytes[], size_t size)
{
    (void)c;
    if (size < sizeof(Model))
        return ERROR;
    memcpy(bytes, state, sizeof(Model));
    return OK;
}
EXPORT int fmi2DeSerializeFMUstate(void *c, const char bytes[], size_t size, void **state)
{
    if (size != sizeof(Model) || fmi2GetFMUstate(c, state) != OK)
        return ERROR;
    memcpy(*state, bytes, sizeof(Model));
    return OK;
}

EXPORT int fmi2GetDirectionalDerivative(void *c, const unsigned unknown[], size_t n, const unsigned known[], size_t m,
                                        const double seed[], double out[])
{
    (void)c; (void)unknown; (void)n; (void)known; (void)m; (void)seed; (void)out;
    return ERROR;
}
EXPORT int fmi2SetRealInputDerivatives(void *c, const unsigned vr[], size_t n, const int order[], const double value[])
{
    for (size_t i = 0; i < n; i++) {
        if (order[i] != 1 || vr[i] < INPUTS || vr[i] >= RATES)
            return ERROR;
        ((Model *)c)->value[vr[i] + NU] = value[i];
    }
    return OK;
}
EXPORT int fmi2GetRealOutputDerivatives(void *c, const unsigned vr[], size_t n, const int order[], double value[])
{
    (void)c; (void)vr; (void)order; (void)value;
    return n > 0 ? ERROR : OK;
}
EXPORT int fmi2DoStep(void *c, double time, double duration, int final) { (void)final; return advance(c, time, duration); }
EXPORT int fmi2CancelStep(void *c) { (void)c; return ERROR; }
#define STATUS(NAME, TYPE) \
    EXPORT int fmi2Get##NAME(void *c, int kind, TYPE *value) { (void)c; (void)kind; (void)value; return ERROR; }
STATUS(Status, int)
STATUS(IntegerStatus, int)
STATUS(BooleanStatus, int)
STATUS(StringStatus, Text)
EXPORT int fmi2GetRealStatus(void *c, int kind, double *value)
{
    *value = ((Model *)c)->value[0];
    return kind == 2 ? OK : ERROR; /* last successful time */
}
