#include "footsense_stages.h"

enum {
    SHORTEST_NS = 2 * FOOTSENSE_STAGE_NS - FOOTSENSE_LONGEST_STAGE_NS,
    /* No source says whether a stage's status or its result changes first. */
    SKEW_NS = 100000,
    N_UNUSED = 2 * FOOTSENSE_STAGES, /* the first results of a new configuration may be junk */
    ALL = (1 << FOOTSENSE_STAGES) - 1,
    SLOTS = 16,
    /* Conversions after which numbers and bounds begin anew: a multiple of stages and of slots; how much the time of a
     * stage may have drifted in them, as a divisor. */
    PERIOD = 7 * SLOTS * FOOTSENSE_STAGES,
    DRIFT_DIVISOR = 2000,
    NONE = INT16_MIN
};

static int64_t max64(int64_t a, int64_t b)
{
    return a > b ? a : b;
}

static int64_t min64(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

static int stage_of(int number)
{
    return number % FOOTSENSE_STAGES;
}

void footsense_stages_start(footsense_stages *stages, footsense_span at)
{
    stages->ended = stages->referred = at;
    stages->shortest = SHORTEST_NS;
    stages->longest = FOOTSENSE_LONGEST_STAGE_NS;
    stages->n_ended = stages->n_referred = 0;
    stages->next = N_UNUSED;
    for (int slot = 0; slot < SLOTS; slot++) {
        stages->number[slot] = NONE;
    }
}

/* Numbers stay small: they begin anew after a period, and the bounds of a stage's time are taken from newer ends. */
static void begin_anew(footsense_stages *stages)
{
    stages->n_ended = (int16_t)(stages->n_ended - PERIOD);
    stages->next = (int16_t)max64(stages->next - PERIOD, FOOTSENSE_STAGES);
    for (int slot = 0; slot < SLOTS; slot++) {
        int16_t number = stages->number[slot];
        stages->number[slot] = number < PERIOD - SLOTS ? NONE : (int16_t)(number - PERIOD);
    }
    stages->n_referred = stages->n_ended;
    stages->referred = stages->ended;
    stages->shortest = (int32_t)max64(stages->shortest - stages->shortest / DRIFT_DIVISOR, SHORTEST_NS);
    stages->longest = (int32_t)min64(stages->longest + stages->longest / DRIFT_DIVISOR, FOOTSENSE_LONGEST_STAGE_NS);
}

/* `n` more conversions had ended at a time, and the next one had not: narrows the bounds; false if they contradict. */
static bool end(footsense_stages *stages, int n, footsense_span at)
{
    int64_t from = stages->ended.from + (int64_t)n * stages->shortest;
    int64_t to = stages->ended.to + (int64_t)n * stages->longest;
    int64_t earliest = at.from - stages->longest;
    int n_since = stages->n_ended + n - stages->n_referred;
    if (from < earliest || to > at.to) {
        from = max64(from, earliest);
        to = min64(to, at.to);
        int64_t shortest = max64(stages->shortest, (from - stages->referred.to) / n_since);
        int64_t longest = min64(stages->longest, (to - stages->referred.from) / n_since + 1);
        if (to < from || shortest > longest) {
            return false;
        }
        stages->shortest = (int32_t)shortest;
        stages->longest = (int32_t)longest;
    }
    stages->ended = (footsense_span){from, to};
    stages->n_ended = (int16_t)(stages->n_ended + n);
    return true;
}

/* Counts what has ended since the last status. */
static bool count(footsense_stages *stages, uint16_t status, footsense_span at)
{
    int n = 0;
    for (uint16_t bits = status; bits != 0; bits = (uint16_t)(bits & (bits - 1u))) {
        n++;
    }
    if (n == 0) {
        return at.from <= stages->ended.to + stages->longest + SKEW_NS;
    }
    if (n < FOOTSENSE_STAGES) {
        unsigned row = ((1u << n) - 1u) << stage_of(stages->n_ended);
        return ((row | row >> FOOTSENSE_STAGES) & (unsigned)ALL) == status && end(stages, n, at);
    }
    /* Some may have ended more than once: only their number by the time tells. */
    int64_t least = (at.from - stages->ended.to) / stages->longest;
    int64_t most = (at.to - stages->ended.from) / stages->shortest;
    return status == ALL && least == most && least >= FOOTSENSE_STAGES && least < PERIOD
           && end(stages, (int)least, at);
}

footsense_taken footsense_stages_take(footsense_stages *stages, uint16_t before, footsense_span before_at,
                                      const uint16_t code[FOOTSENSE_STAGES], uint16_t behind,
                                      footsense_span behind_at)
{
    if (!count(stages, before, before_at)) {
        /* A result is no status; then the one behind it is the first. */
        return count(stages, behind, behind_at) ? FOOTSENSE_AGAIN : FOOTSENSE_DOUBT;
    }
    footsense_span ended = stages->ended;
    int first = stages->n_ended, last = first;
    if (!count(stages, behind, behind_at)) {
        return FOOTSENSE_DOUBT;
    }
    if (ended.to - ended.from <= stages->shortest) {
        /* What ended near to a status may be in it or not, and its result new or not. */
        if (ended.to > before_at.from - SKEW_NS) {
            last--;
        }
        first = stages->n_ended;
        if (behind == 0 && ended.from + stages->shortest < before_at.to + SKEW_NS) {
            first++;
        }
        first = (int)max64(first - FOOTSENSE_STAGES, stages->next);
        for (int number = first; number < last; number++) {
            int slot = number % SLOTS;
            stages->number[slot] = (int16_t)number;
            stages->code[slot] = code[stage_of(number)];
        }
        stages->next = (int16_t)max64(stages->next, last);
    }
    if (stages->n_ended >= PERIOD + SLOTS) {
        begin_anew(stages);
    }
    return FOOTSENSE_TAKEN;
}

footsense_run footsense_stages_newest(const footsense_stages *stages)
{
    int number = stages->next - FOOTSENSE_STAGES;
    footsense_run run = {.step_ns = (stages->shortest + stages->longest) / 2, .first = (uint8_t)stage_of(number)};
    run.t_ns = (stages->ended.from + stages->ended.to) / 2
               + (int64_t)(2 * (number - stages->n_ended) + 1) * run.step_ns / 2;
    for (unsigned k = 0; k < FOOTSENSE_STAGES; k++, number++) {
        int slot = number % SLOTS;
        run.code[k] = stages->code[slot];
        if (stages->number[slot] != number) {
            run.missing = (uint16_t)(run.missing | 1u << k);
        }
    }
    return run;
}
