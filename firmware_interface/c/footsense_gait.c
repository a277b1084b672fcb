#include "footsense_gait.h"

static const uint64_t REPEAT_US = 1000000u;

bool footsense_take_event(footsense_events *events, uint32_t id, const uint8_t *data, uint8_t len, uint64_t now_us,
                          footsense_event *out)
{
    footsense_gait_event event;
    if (!footsense_decode_gait_event(id, data, len, &event)) {
        return false;
    }
    unsigned leg = event.node - 1u;
    bool repeated = events->kinds[leg] == event.kind && events->counters[leg] == event.counter
                    && now_us - events->arrived_us[leg] < REPEAT_US;
    events->kinds[leg] = event.kind;
    events->counters[leg] = event.counter;
    events->arrived_us[leg] = now_us;
    if (repeated) {
        return false;
    }
    out->node = event.node;
    out->kind = event.kind;
    out->all_in_air = event.all_in_air;
    out->has_time = event.age_us != FOOTSENSE_NO_AGE && event.age_us <= now_us;
    out->sigma_us = event.sigma_us;
    out->t_us = out->has_time ? now_us - event.age_us : 0;
    return true;
}
