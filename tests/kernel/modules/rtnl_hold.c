// SPDX-License-Identifier: GPL-2.0
/*
 * Takes the lock of the network configuration (RTNL) while it loads, for `ms` milliseconds, as the driver of an
 * adapter does that is slow to come up or to go. Loading then fails on purpose, so that it can be repeated.
 */
#include <linux/delay.h>
#include <linux/module.h>
#include <linux/rtnetlink.h>

static unsigned int ms = 1000;
module_param(ms, uint, 0444);
MODULE_PARM_DESC(ms, "how long the lock is held");

static int __init rtnl_hold_init(void)
{
	rtnl_lock();
	msleep(ms);
	rtnl_unlock();
	return -EAGAIN;
}
module_init(rtnl_hold_init);

MODULE_DESCRIPTION("Holds RTNL for a while");
MODULE_LICENSE("GPL");
