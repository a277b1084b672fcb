/* Tells from the forces on CAN when a tripod may swing: the other three feet stand, and each of their forces is usable.
 *
 *     cc -std=c99 -I firmware_interface/c -o gait_controller examples/gait_controller.c firmware_interface/c/footsense_*.c
 *     candump -L can0 | ./gait_controller
 *
 * Without a robot: `footsense run --duration 10 --can-log walk.log`, then `./gait_controller < walk.log`.
 * On a microcontroller your CAN interrupt is in the place of candump.
 */
#include <inttypes.h>
#include <stdio.h>

#include "footsense_link.h"

#define STANDS_MN 150 /* along the leg: far above the noise */

static const char *const names[] = {"", "lf", "lm", "lr", "rf", "rm", "rr"};
static const unsigned tripods[2] = {1u << 1 | 1u << 3 | 1u << 5, 1u << 2 | 1u << 4 | 1u << 6}; /* left, right: nodes */

int main(void)
{
    footsense_limits limits = FOOTSENSE_DEFAULT_LIMITS;
    footsense_link feet;
    char line[256], hex[17];
    bool stood[2] = {false, false}, used[7] = {false}, is_log = false;
    footsense_link_init(&feet, &limits);
    while (fgets(line, sizeof line, stdin)) {
        uint64_t s, us;
        uint32_t id;
        uint8_t data[8], len = 0;
        if (sscanf(line, "(%" SCNu64 ".%" SCNu64 ") %*s %3" SCNx32 "#%16[0-9A-F]", &s, &us, &id, hex) != 4)
            continue; /* no classic frame with data and an id of 11 bits */
        for (unsigned byte; len < 8 && sscanf(hex + 2 * len, "%2x", &byte) == 1; ++len)
            data[len] = (uint8_t)byte;
        is_log = true;
        uint64_t now_us = 1000000u * s + us;
        if (!footsense_feed(&feet, id, data, len, now_us))
            continue;
        unsigned standing = 0; /* a foot without a usable force is none to stand on */
        for (uint8_t node = 1; node <= 6; ++node) {
            footsense_leg_force leg = footsense_get_leg_force(&feet, node, now_us);
            if (leg.usable != used[node])
                printf("%8.3f s  %s %s: link %d, state %d\n", 1e-6 * (double)now_us, names[node],
                       leg.usable ? "used" : "refused", (int)leg.status, (int)leg.state);
            used[node] = leg.usable;
            if (leg.usable && 1000LL * leg.force_mn[2] - 2LL * leg.sigma_un[2] > 1000LL * STANDS_MN)
                standing |= 1u << node;
        }
        for (int tripod = 0; tripod < 2; ++tripod) {
            bool now = (standing & tripods[tripod]) == tripods[tripod];
            if (now != stood[tripod])
                printf("%8.3f s  %s tripod %s\n", 1e-6 * (double)now_us, tripod ? "left" : "right",
                       now ? "may swing" : "has to stand");
            stood[tripod] = now;
        }
    }
    if (!is_log)
        fputs("no line of candump -L seen; use: candump -L can0 | ./gait_controller\n", stderr);
    return is_log ? 0 : 1;
}
