#include "footsense_link.h"

#include <string.h>

/* Shortest silence of a leg in which its service may have been started anew, with other feet. */
static const uint32_t RESTART_US = 300000u;

/* Two services: how long their signs count, within what time an `Identity` follows on the last one, of which it is one
 * more, and within what it may be the same frame sent again. */
static const uint32_t CONFLICT_US = 3000000u;
static const uint32_t IDENTITY_PERIOD_US = 1500000u;
static const uint32_t SENT_AGAIN_US = 10000u;

/* Whether more than `limit` has passed; a clock that ran backwards has run out. */
static bool is_over(uint64_t now_us, uint64_t since_us, uint32_t limit_us)
{
    return now_us - since_us > limit_us;
}

static bool has_force(uint8_t state)
{
    return state == FOOTSENSE_VALID || state == FOOTSENSE_DEGRADED;
}

static bool is_silent(const footsense_link *link, const footsense_leg *leg, uint64_t now_us)
{
    return !leg->heard || is_over(now_us, leg->arrived_us, link->limits.timeout_us);
}

static void distrust(footsense_leg *leg, footsense_status why)
{
    leg->status = why;
    leg->n_good = 0;
}

static void take_wrong(footsense_leg *leg, uint64_t now_us)
{
    distrust(leg, FOOTSENSE_LINK_WRONG);
    leg->wrong_us = now_us;
    leg->has_force = false;
    leg->has_quality = false;
}

static void take_repeated(const footsense_link *link, footsense_leg *leg)
{
    if (leg->n_good >= link->limits.min_good) {
        leg->status = FOOTSENSE_LINK_REPEATED;
    }
}

/* A service sends the same until it ends, and counts: while forces come, who sends something else, or does not count
 * on, is a second one. */
static void take_identity(const footsense_link *link, footsense_leg *leg, const footsense_identity *identity,
                          uint64_t now_us)
{
    const footsense_identity *last = &leg->identity;
    if (last->node != 0 && !is_silent(link, leg, now_us)) {
        bool same = identity->version == last->version && identity->force_step_mn == last->force_step_mn
                    && identity->foot_type_hash == last->foot_type_hash;
        bool counts_on = identity->counter == (last->counter + 1u) % FOOTSENSE_COUNTER_PERIOD;
        bool sent_again = identity->counter == last->counter && !is_over(now_us, leg->identity_us, SENT_AGAIN_US);
        bool is_late = is_over(now_us, leg->identity_us, IDENTITY_PERIOD_US);
        if (!same || !(counts_on || sent_again || is_late)) {
            distrust(leg, FOOTSENSE_LINK_STALE);
            leg->conflicted = true;
            leg->conflict_us = now_us;
        }
    }
    leg->identity = *identity;
    leg->identity_us = now_us;
}

static bool is_known(const footsense_identity *identity)
{
    uint8_t step = identity->force_step_mn;
    return identity->version == FOOTSENSE_PROTOCOL_VERSION
           && (step == 1 || step == 2 || step == 5 || step == 10 || step == 20);
}

/* Both halves of a force are there. */
static void take_force(const footsense_link *link, footsense_leg *leg, uint64_t now_us)
{
    if (leg->heard && is_over(now_us, leg->arrived_us, RESTART_US)
        && is_over(now_us, leg->identity_us, RESTART_US)) {
        leg->identity.node = 0;
    }
    uint8_t delta = (uint8_t)((leg->next_counter + FOOTSENSE_COUNTER_PERIOD - leg->force.counter)
                              % FOOTSENSE_COUNTER_PERIOD);
    bool counts = true;
    if (is_silent(link, leg, now_us)) {
        /* Whatever the counter says: who was silent may have begun anew. */
        distrust(leg, FOOTSENSE_LINK_STALE);
        delta = 1;
    } else if (delta > link->limits.max_delta) {
        distrust(leg, FOOTSENSE_LINK_WRONG);
        leg->wrong_us = now_us;
        counts = false;
    }
    leg->force = leg->next_force;
    leg->quality = leg->next_quality;
    leg->arrived_us = leg->next_us;
    leg->heard = true;
    leg->has_force = false;
    leg->has_quality = false;
    if (counts && leg->n_good < link->limits.min_good) {
        leg->n_good++;
    }
    if (leg->n_good >= link->limits.min_good) {
        leg->status = delta == 1 ? FOOTSENSE_LINK_OK : FOOTSENSE_LINK_LOST;
    }
}

void footsense_link_init(footsense_link *link, const footsense_limits *limits)
{
    memset(link, 0, sizeof *link);
    link->limits = *limits;
    if (link->limits.min_good == 0) {
        link->limits.min_good = 1;
    }
}

/* One half of a force: the one that is not null. */
static void take_half(const footsense_link *link, footsense_leg *leg, const footsense_force *force,
                      const footsense_quality *quality, uint64_t now_us)
{
    uint8_t counter = force ? force->counter : quality->counter;
    if (!is_silent(link, leg, now_us) && counter == leg->force.counter) {
        take_repeated(link, leg);
        return;
    }
    if (counter != leg->next_counter || is_over(now_us, leg->next_us, link->limits.timeout_us)) {
        leg->has_force = false;
        leg->has_quality = false;
    }
    if (force ? leg->has_force : leg->has_quality) {
        take_repeated(link, leg);
        return;
    }
    if (!leg->has_force && !leg->has_quality) {
        leg->next_us = now_us;
        leg->next_counter = counter;
    }
    if (force) {
        leg->next_force = *force;
        leg->has_force = true;
        if (!has_force(force->state)) {
            leg->force.state = force->state;
        }
    } else {
        leg->next_quality = *quality;
        leg->has_quality = true;
    }
    if (leg->has_force && leg->has_quality) {
        take_force(link, leg, now_us);
    }
}

bool footsense_feed(footsense_link *link, uint32_t id, const uint8_t *data, uint8_t len, uint64_t now_us)
{
    if (id > FOOTSENSE_IDENTITY_ID && id <= FOOTSENSE_IDENTITY_ID + FOOTSENSE_LEGS) {
        footsense_identity identity;
        if (footsense_decode_identity(id, data, len, &identity)) {
            take_identity(link, &link->legs[identity.node - 1u], &identity, now_us);
        } /* or the next one comes in a second */
        return true;
    }
    if (id > FOOTSENSE_FAULT_ID && id <= FOOTSENSE_FAULT_ID + FOOTSENSE_LEGS) {
        footsense_fault fault;
        if (footsense_decode_fault(id, data, len, &fault)) {
            footsense_leg *told = &link->legs[fault.node - 1u];
            told->fault_mask = fault.fault_mask;
            told->has_mask = true;
        }
        return true;
    }
    bool is_force = id > FOOTSENSE_FORCE_ID && id <= FOOTSENSE_FORCE_ID + FOOTSENSE_LEGS;
    bool is_quality = id > FOOTSENSE_QUALITY_ID && id <= FOOTSENSE_QUALITY_ID + FOOTSENSE_LEGS;
    if (!is_force && !is_quality) {
        return false;
    }
    footsense_leg *leg = &link->legs[id - (is_force ? FOOTSENSE_FORCE_ID : FOOTSENSE_QUALITY_ID) - 1u];
    footsense_force force;
    footsense_quality quality;
    if (is_force ? !footsense_decode_force(id, data, len, &force)
                 : !footsense_decode_quality(id, data, len, &quality)) {
        take_wrong(leg, now_us);
    } else {
        take_half(link, leg, is_force ? &force : NULL, is_force ? NULL : &quality, now_us);
    }
    return true;
}

static bool is_too_old(const footsense_link *link, const footsense_leg *leg, uint64_t now_us)
{
    uint32_t limit_us = link->limits.max_age_us;
    uint32_t age_us = leg->quality.age_us;
    return age_us == FOOTSENSE_NO_AGE || age_us > limit_us
           || is_over(now_us, leg->arrived_us, limit_us - age_us);
}

static footsense_status status_of(const footsense_link *link, const footsense_leg *leg, uint64_t now_us)
{
    if (is_silent(link, leg, now_us)) {
        bool just_wrong = leg->status == FOOTSENSE_LINK_WRONG
                          && !is_over(now_us, leg->wrong_us, link->limits.timeout_us);
        return just_wrong ? FOOTSENSE_LINK_WRONG : FOOTSENSE_LINK_STALE;
    }
    if (leg->conflicted && !is_over(now_us, leg->conflict_us, CONFLICT_US)) {
        return FOOTSENSE_LINK_CONFLICT;
    }
    /* Only a force has an age; that a leg is absent stays true. */
    if (leg->status != FOOTSENSE_LINK_WRONG && has_force(leg->force.state) && is_too_old(link, leg, now_us)) {
        return FOOTSENSE_LINK_STALE;
    }
    if (leg->status == FOOTSENSE_LINK_STALE || leg->status == FOOTSENSE_LINK_WRONG
        || (leg->identity.node != 0 && is_known(&leg->identity))) {
        return leg->status;
    }
    return leg->identity.node != 0 ? FOOTSENSE_LINK_REFUSED : FOOTSENSE_LINK_UNKNOWN;
}

footsense_leg_force footsense_get_leg_force(const footsense_link *link, uint8_t node, uint64_t now_us)
{
    footsense_leg_force view;
    memset(&view, 0, sizeof view);
    view.age_us = FOOTSENSE_NO_AGE;
    for (int axis = 0; axis < 3; axis++) {
        view.force_mn[axis] = FOOTSENSE_NO_FORCE;
        view.sigma_un[axis] = FOOTSENSE_NO_SIGMA_UN;
    }
    view.fault_mask = FOOTSENSE_NO_MASK;
    view.contact_permille = FOOTSENSE_NO_RATIO;
    view.holds_permille = FOOTSENSE_NO_RATIO;
    if (node < 1 || node > FOOTSENSE_LEGS) {
        return view;
    }
    const footsense_leg *leg = &link->legs[node - 1];
    view.status = status_of(link, leg, now_us);
    view.state = leg->force.state;
    view.flags = leg->quality.flags;
    view.fault_mask = leg->has_mask ? leg->fault_mask : FOOTSENSE_NO_MASK;
    view.usable = (view.status == FOOTSENSE_LINK_OK || view.status == FOOTSENSE_LINK_LOST)
                  && (view.state == FOOTSENSE_VALID
                      || (view.state == FOOTSENSE_DEGRADED && link->limits.accept_degraded));
    for (int axis = 0; axis < 3; axis++) {
        view.usable = view.usable && leg->force.force_mn[axis] != FOOTSENSE_NO_FORCE
                      && leg->quality.sigma_un[axis] != FOOTSENSE_NO_SIGMA_UN;
    }
    if (view.usable) {
        for (int axis = 0; axis < 3; axis++) {
            view.force_mn[axis] = leg->force.force_mn[axis] * leg->identity.force_step_mn;
            view.sigma_un[axis] = leg->quality.sigma_un[axis] * leg->identity.force_step_mn;
        }
        view.contact_permille = leg->quality.contact_permille;
        view.holds_permille = leg->quality.holds_permille;
        view.age_us = leg->quality.age_us + (uint32_t)(now_us - leg->arrived_us);
    }
    return view;
}
