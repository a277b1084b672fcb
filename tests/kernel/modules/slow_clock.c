// SPDX-License-Identifier: GPL-2.0
/*
 * Makes timers agree with a clock that is slower than the emulator's.
 *
 * The emulator counts an instruction as a nanosecond, which is less than the processors of a robot's computer do. The
 * kernel is told (`tsc_early_khz`) that its time stamp counter, which counts them, counts several a nanosecond. It still
 * finds the true rate of its timer by another clock (PM timer), and timers would be early: here that is set right.
 */
#include <linux/clockchips.h>
#include <linux/kprobes.h>
#include <linux/math64.h>
#include <linux/module.h>
#include <asm/tsc.h>

#define TSC_KHZ 1000000 /* by the emulator's time */

/* Returns a function of the kernel that is not for modules; NULL if there is none. */
static void *function(const char *name)
{
	struct kprobe probe = { .symbol_name = name };
	void *found;

	if (register_kprobe(&probe))
		return NULL;
	found = probe.addr;
	unregister_kprobe(&probe);
	return found;
}

static int __init slow_clock_init(void)
{
	struct tick_device { struct clock_event_device *event; } *(*device_of)(int) = function("tick_get_device");
	int (*set_hz)(struct clock_event_device *event, u32 hz) = function("clockevents_update_freq");
	struct clock_event_device *timer;
	u64 hz;

	if (!device_of || !set_hz)
		return -ENOENT;
	timer = device_of(0)->event;
	hz = (u64)timer->mult * NSEC_PER_SEC >> timer->shift;
	hz = div_u64(hz * tsc_khz, TSC_KHZ);
	pr_info("slow_clock: %s at %llu Hz\n", timer->name, hz);
	set_hz(timer, hz);
	return 0;
}
module_init(slow_clock_init);

MODULE_DESCRIPTION("Timers of a clock that is slower than the emulator's");
MODULE_LICENSE("GPL");
