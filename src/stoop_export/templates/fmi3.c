/* Functional Mock-up Interface 3.0, co-simulation. */
EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT int fmi3SetDebugLogging(void *c, bool on, size_t n, const char *const categories[])
{
    (void)c; (void)on; (void)n; (void)categories;
    return OK;
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *place, bool visible, bool logging,
                                         bool events, bool early, const uint32_t required[], size_t count,
                                         void *environment, void (*logger)(void *, int, const char *, const char *),
                                         void (*intermediate)(void))
{
    (void)name; (void)place; (void)visible; (void)logging; (void)events; (void)early; (void)required; (void)environment;
    (void)logger; (void)intermediate;
    if (count > 0 || token == NULL || strcmp(token, TOKEN) != 0)
        return NULL;
    Model *m = malloc(sizeof(Model));
    if (m != NULL)
        reset(m);
    return m;
}

EXPORT void fmi3FreeInstance(void *c) { free(c); }
EXPORT int fmi3EnterInitializationMode(void *c, bool tolerant, double tolerance, double start, bool stops, double stop)
{
    (void)tolerant; (void)tolerance; (void)stops; (void)stop;
    ((Model *)c)->value[0] = start;
    return OK;
}
EXPORT int fmi3ExitInitializationMode(void *c)
{
    refresh(c);
    ((Model *)c)->running = true;
    return OK;
}
EXPORT int fmi3Terminate(void *c) { (void)c; return OK; }
EXPORT int fmi3Reset(void *c) { reset(c); return OK; }

EXPORT int fmi3GetFloat64(void *c, const uint32_t vr[], size_t n, double values[], size_t count)
{
    return count == n ? get(c, vr, n, values) : ERROR;
}
EXPORT int fmi3SetFloat64(void *c, const uint32_t vr[], size_t n, const double values[], size_t count)
{
    return count == n ? set(c, vr, n, values) : ERROR;
}
#define NONE(NAME, TYPE) \
    EXPORT int fmi3Get##NAME(void *c, const uint32_t vr[], size_t n, TYPE values[], size_t count) \
    { (void)c; (void)vr; (void)values; (void)count; return n > 0 ? ERROR : OK; } \
    EXPORT int fmi3Set##NAME(void *c, const uint32_t vr[], size_t n, const TYPE values[], size_t count) \
    { (void)c; (void)vr; (void)values; (void)count; return n > 0 ? ERROR : OK; }
typedef const char *Text;
typedef const uint8_t *Bytes;
NONE(Float32, float)
NONE(Int8, int8_t)
NONE(UInt8, uint8_t)
NONE(Int16, int16_t)
NONE(UInt16, uint16_t)
NONE(Int32, int32_t)
NONE(UInt32, uint32_t)
NONE(Int64, int64_t)
NONE(UInt64, uint64_t)
NONE(Boolean, bool)
NONE(String, Text)
EXPORT int fmi3GetBinary(void *c, const uint32_t vr[], size_t n, size_t sizes[], Bytes values[], size_t count)
{
    (void)c; (void)vr; (void)sizes; (void)values; (void)count;
    return n > 0 ? ERROR : OK;
}
EXPORT int fmi3SetBinary(void *c, const uint32_t vr[], size_t n, const size_t sizes[], const Bytes values[], size_t count)
{
    (void)c; (void)vr; (void)sizes; (void)values; (void)count;
    return n > 0 ? ERROR : OK;
}

EXPORT int fmi3GetFMUState(void *c, void **state)
{
    if (*state == NULL)
        *state = malloc(sizeof(Model));
    if (*state == NULL)
        return ERROR;
    memcpy(*state, c, sizeof(Model));
    return OK;
}
EXPORT int fmi3SetFMUState(void *c, void *state) { memcpy(c, state, sizeof(Model)); return OK; }
EXPORT int fmi3FreeFMUState(void *c, void **state) { (void)c; free(*state); *state = NULL; return OK; }
EXPORT int fmi3SerializedFMUStateSize(void *c, void *state, size_t *size)
{
    (void)c; (void)state;
    *size = sizeof(Model);
    return OK;
}
EXPORT int fmi3SerializeFMUState(void *c, void *state, uint8_t bytes[], size_t size)
{
    (void)c;
    if (size < sizeof(Model))
        return ERROR;
    memcpy(bytes, state, sizeof(Model));
    return OK;
}
EXPORT int fmi3DeserializeFMUState(void *c, const uint8_t bytes[], size_t size, void **state)
{
    if (size != sizeof(Model) || fmi3GetFMUState(c, state) != OK)
        return ERROR;
    memcpy(*state, bytes, sizeof(Model));
    return OK;
}

EXPORT int fmi3EnterStepMode(void *c) { (void)c; return OK; }
EXPORT int fmi3DoStep(void *c, double time, double duration, bool final, bool *event, bool *terminate, bool *early,
                      double *last)
{
    (void)final;
    const int status = advance(c, time, duration);
    *event = *terminate = *early = false;
    *last = ((Model *)c)->value[0];
    return status;
}

/* What a unit without events, clocks, continuous states of its importer or derivatives of outputs has no use for: a call is
   an error, whatever its arguments. */
#define UNUSED(NAME) EXPORT int fmi3##NAME(void) { return ERROR; }
UNUSED(ActivateModelPartition)
UNUSED(CompletedIntegratorStep)
UNUSED(EnterConfigurationMode)
UNUSED(EnterContinuousTimeMode)
UNUSED(EnterEventMode)
UNUSED(EvaluateDiscreteStates)
UNUSED(ExitConfigurationMode)
UNUSED(GetAdjointDerivative)
UNUSED(GetClock)
UNUSED(GetContinuousStateDerivatives)
UNUSED(GetContinuousStates)
UNUSED(GetDirectionalDerivative)
UNUSED(GetEventIndicators)
UNUSED(GetIntervalDecimal)
UNUSED(GetIntervalFraction)
UNUSED(GetNominalsOfContinuousStates)
UNUSED(GetNumberOfContinuousStates)
UNUSED(GetNumberOfEventIndicators)
UNUSED(GetNumberOfVariableDependencies)
UNUSED(GetOutputDerivatives)
UNUSED(GetShiftDecimal)
UNUSED(GetShiftFraction)
UNUSED(GetVariableDependencies)
UNUSED(SetClock)
UNUSED(SetContinuousStates)
UNUSED(SetIntervalDecimal)
UNUSED(SetIntervalFraction)
UNUSED(SetShiftDecimal)
UNUSED(SetShiftFraction)
UNUSED(SetTime)
UNUSED(UpdateDiscreteStates)
EXPORT void *fmi3InstantiateModelExchange(void) { return NULL; }
EXPORT void *fmi3InstantiateScheduledExecution(void) { return NULL; }
