// SPDX-License-Identifier: GPL-2.0
/*
 * I2C adapters without hardware: a program in user space answers their transfers.
 *
 *   i2c_transfer() -> read() of /dev/feet-adapter    one request
 *                  <- write() to /dev/feet-adapter   its answer
 *
 * Request: struct request_head, n_messages times struct request_message, then the bytes of all written messages.
 * Answer:  struct answer_head, then the bytes of all read messages if the result is not negative.
 *
 * A transfer ends when the answer says, as it takes its time on the wire. One that is not answered within the adapter's timeout (I2C_TIMEOUT) ends with -ETIMEDOUT, as on a bus whose
 * data line is held. Without a program -ENXIO, without the adapter -ENODEV.
 *
 * /sys/module/feet_adapter/parameters/plugged: a bit for each adapter. Without it the adapter is taken away, as a pulled
 * USB plug does; with it, a new one is added.
 * A GPIO chip of one line counts the low pulses on it: the RESET pin of a multiplexer.
 */
#include <linux/fs.h>
#include <linux/gpio/driver.h>
#include <linux/hrtimer.h>
#include <linux/i2c.h>
#include <linux/miscdevice.h>
#include <linux/module.h>
#include <linux/mutex.h>
#include <linux/poll.h>
#include <linux/slab.h>
#include <linux/uaccess.h>
#include <linux/wait.h>
#include <linux/workqueue.h>

#define MAX_MESSAGES 16
#define MAX_BYTES 2048

struct request_head {
	__u32 serial;
	__u32 adapter; /* the N of /dev/i2c-N */
	__u32 reset_pulses;
	__u32 n_messages;
};

struct request_message {
	__u16 address;
	__u16 flags;
	__u16 length;
	__u16 zero;
};

struct answer_head {
	__u32 serial;
	__s32 result;
	__s64 ends_ns; /* CLOCK_MONOTONIC */
};

enum stage { IDLE, ASKED, TAKEN, ANSWERED };

/* An adapter, and the transfer under way; `lock` guards all of it. */
struct bus {
	int number; /* the N of /dev/i2c-N */
	struct i2c_adapter *plugged;
	enum stage stage;
	struct i2c_msg *messages;
	int n_messages;
	u32 serial;
	int result;
	s64 ends_ns;
};

static struct bus buses[] = { { .number = 1 }, { .number = 3 } };
#define for_each_bus(bus) for (bus = buses; bus < buses + ARRAY_SIZE(buses); bus++)

static DEFINE_MUTEX(lock);
static DECLARE_WAIT_QUEUE_HEAD(to_server);
static DECLARE_WAIT_QUEUE_HEAD(to_caller);
static u32 serial;
static bool served;

static u32 reset_pulses;
static int reset_level = 1;

/* Ends a transfer under way; the caller holds `lock`. */
static void finish(struct bus *bus, int with)
{
	if (bus->stage != ASKED && bus->stage != TAKEN)
		return;
	bus->result = with;
	bus->stage = ANSWERED;
	wake_up(&to_caller);
}

static int feet_transfer(struct i2c_adapter *adapter, struct i2c_msg *msgs, int n)
{
	struct bus *bus = i2c_get_adapdata(adapter);
	size_t bytes = 0;
	ktime_t ends;
	int i, ended_with;

	for (i = 0; i < n; i++)
		bytes += msgs[i].len;
	if (n > MAX_MESSAGES || bytes > MAX_BYTES)
		return -EOPNOTSUPP;

	mutex_lock(&lock);
	if (adapter != bus->plugged || !served) {
		ended_with = adapter != bus->plugged ? -ENODEV : -ENXIO;
		mutex_unlock(&lock);
		return ended_with;
	}
	bus->messages = msgs;
	bus->n_messages = n;
	bus->serial = ++serial;
	bus->ends_ns = 0;
	bus->stage = ASKED;
	mutex_unlock(&lock);

	wake_up_interruptible(&to_server);
	wait_event_timeout(to_caller, READ_ONCE(bus->stage) == ANSWERED, adapter->timeout);

	mutex_lock(&lock);
	ended_with = bus->stage == ANSWERED ? bus->result : -ETIMEDOUT;
	ends = ns_to_ktime(bus->ends_ns);
	bus->stage = IDLE;
	bus->messages = NULL;
	mutex_unlock(&lock);
	if (ends > ktime_get()) {
		set_current_state(TASK_UNINTERRUPTIBLE);
		schedule_hrtimeout(&ends, HRTIMER_MODE_ABS);
	}
	return ended_with;
}

static u32 feet_functionality(struct i2c_adapter *adapter)
{
	return I2C_FUNC_I2C | I2C_FUNC_SMBUS_EMUL;
}

static const struct i2c_algorithm feet_algorithm = {
	.master_xfer = feet_transfer,
	.functionality = feet_functionality,
};

/* ---- plug and unplug ---- */

struct departure {
	struct work_struct work;
	struct i2c_adapter *adapter;
};

static int add_adapter(struct bus *bus)
{
	struct i2c_adapter *adapter = kzalloc(sizeof(*adapter), GFP_KERNEL);
	int error;

	if (!adapter)
		return -ENOMEM;
	adapter->owner = THIS_MODULE;
	adapter->algo = &feet_algorithm;
	adapter->nr = bus->number;
	strscpy(adapter->name, "feet in user space", sizeof(adapter->name));
	i2c_set_adapdata(adapter, bus);
	mutex_lock(&lock);
	bus->plugged = adapter;
	mutex_unlock(&lock);
	error = i2c_add_numbered_adapter(adapter);
	if (error == -EBUSY) /* the one before is still open somewhere: the next free number, as for a USB adapter */
		error = i2c_add_adapter(adapter);
	if (error) {
		mutex_lock(&lock);
		bus->plugged = NULL;
		mutex_unlock(&lock);
		kfree(adapter);
	}
	return error;
}

static void delete_adapter(struct work_struct *work)
{
	struct departure *departure = container_of(work, struct departure, work);

	i2c_del_adapter(departure->adapter); /* returns when nobody has its device file open any more */
	kfree(departure->adapter);
	kfree(departure);
}

static int remove_adapter(struct bus *bus)
{
	struct departure *departure = kzalloc(sizeof(*departure), GFP_KERNEL);

	if (!departure)
		return -ENOMEM;
	INIT_WORK(&departure->work, delete_adapter);
	mutex_lock(&lock);
	departure->adapter = bus->plugged;
	bus->plugged = NULL;
	finish(bus, -ENODEV);
	mutex_unlock(&lock);
	queue_work(system_unbound_wq, &departure->work);
	return 0;
}

static int plugged_set(const char *text, const struct kernel_param *parameter)
{
	unsigned int wanted;
	int error = kstrtouint(text, 0, &wanted);
	struct bus *bus;

	for_each_bus(bus) {
		if (!error && (wanted & 1) != !!bus->plugged)
			error = wanted & 1 ? add_adapter(bus) : remove_adapter(bus);
		wanted >>= 1;
	}
	return error;
}

static int plugged_get(char *text, const struct kernel_param *parameter)
{
	unsigned int plugged = 0;
	struct bus *bus;

	for_each_bus(bus)
		plugged |= !!bus->plugged << (bus - buses);
	return sysfs_emit(text, "%u\n", plugged);
}

static const struct kernel_param_ops plugged_operations = {
	.set = plugged_set,
	.get = plugged_get,
};
module_param_cb(plugged, &plugged_operations, NULL, 0644);
MODULE_PARM_DESC(plugged, "which adapters are there");

/* ---- the program's end ---- */

static int server_open(struct inode *inode, struct file *file)
{
	int error = 0;

	mutex_lock(&lock);
	if (served)
		error = -EBUSY;
	served = true;
	mutex_unlock(&lock);
	return error;
}

static int server_release(struct inode *inode, struct file *file)
{
	struct bus *bus;

	mutex_lock(&lock);
	served = false;
	for_each_bus(bus)
		finish(bus, -ENXIO);
	mutex_unlock(&lock);
	return 0;
}

/* Returns the bus whose transfer is at a stage, of a serial number unless that is 0; NULL for none. */
static struct bus *bus_at(enum stage stage, u32 serial)
{
	struct bus *bus;

	for_each_bus(bus)
		if (READ_ONCE(bus->stage) == stage && (!serial || bus->serial == serial))
			return bus;
	return NULL;
}

static ssize_t server_read(struct file *file, char __user *to, size_t size, loff_t *position)
{
	struct request_message described;
	struct request_head head;
	ssize_t length = sizeof(head);
	struct bus *bus;
	int i;

	do {
		if (wait_event_interruptible(to_server, bus_at(ASKED, 0)))
			return -ERESTARTSYS;
		mutex_lock(&lock);
		bus = bus_at(ASKED, 0);
		if (bus)
			break;
		mutex_unlock(&lock); /* it has timed out meanwhile */
	} while (true);

	if (size < sizeof(head) + MAX_MESSAGES * sizeof(described) + MAX_BYTES) {
		mutex_unlock(&lock);
		return -EINVAL;
	}
	head.serial = bus->serial;
	head.adapter = bus->number;
	head.reset_pulses = reset_pulses;
	head.n_messages = bus->n_messages;
	if (copy_to_user(to, &head, sizeof(head)))
		goto fault;
	for (i = 0; i < bus->n_messages; i++) {
		described.address = bus->messages[i].addr;
		described.flags = bus->messages[i].flags;
		described.length = bus->messages[i].len;
		described.zero = 0;
		if (copy_to_user(to + length, &described, sizeof(described)))
			goto fault;
		length += sizeof(described);
	}
	for (i = 0; i < bus->n_messages; i++) {
		if (bus->messages[i].flags & I2C_M_RD)
			continue;
		if (copy_to_user(to + length, bus->messages[i].buf, bus->messages[i].len))
			goto fault;
		length += bus->messages[i].len;
	}
	bus->stage = TAKEN;
	mutex_unlock(&lock);
	return length;
fault:
	mutex_unlock(&lock);
	return -EFAULT;
}

static ssize_t server_write(struct file *file, const char __user *from, size_t size, loff_t *position)
{
	size_t length = sizeof(struct answer_head);
	struct answer_head head;
	struct bus *bus;
	int i;

	if (size < sizeof(head))
		return -EINVAL;
	if (copy_from_user(&head, from, sizeof(head)))
		return -EFAULT;
	mutex_lock(&lock);
	bus = bus_at(TAKEN, head.serial);
	if (!bus) { /* too late: the caller has gone */
		mutex_unlock(&lock);
		return size;
	}
	for (i = 0; i < bus->n_messages && head.result >= 0; i++) {
		if (!(bus->messages[i].flags & I2C_M_RD))
			continue;
		if (size - length < bus->messages[i].len ||
		    copy_from_user(bus->messages[i].buf, from + length, bus->messages[i].len)) {
			head.result = -EIO;
			break;
		}
		length += bus->messages[i].len;
	}
	bus->ends_ns = head.ends_ns;
	finish(bus, head.result);
	mutex_unlock(&lock);
	return size;
}

static const struct file_operations server_operations = {
	.owner = THIS_MODULE,
	.open = server_open,
	.release = server_release,
	.read = server_read,
	.write = server_write,
};

static struct miscdevice server_device = {
	.minor = MISC_DYNAMIC_MINOR,
	.name = "feet-adapter",
	.fops = &server_operations,
};

/* ---- the RESET pin ---- */

static void reset_set(struct gpio_chip *chip, unsigned int line, int value)
{
	if (reset_level && !value)
		reset_pulses++;
	reset_level = value;
}

static int reset_get(struct gpio_chip *chip, unsigned int line)
{
	return reset_level;
}

static int reset_output(struct gpio_chip *chip, unsigned int line, int value)
{
	reset_set(chip, line, value);
	return 0;
}

static int reset_input(struct gpio_chip *chip, unsigned int line)
{
	reset_level = 1; /* a pull-up */
	return 0;
}

static struct gpio_chip reset_chip = {
	.label = "feet-adapter",
	.owner = THIS_MODULE,
	.base = -1,
	.ngpio = 1,
	.set = reset_set,
	.get = reset_get,
	.direction_output = reset_output,
	.direction_input = reset_input,
};

/* The module cannot go while an adapter of it is open, so that the plugged ones are free. */
static void remove_all(void)
{
	struct bus *bus;

	for_each_bus(bus) {
		if (bus->plugged) {
			i2c_del_adapter(bus->plugged);
			kfree(bus->plugged);
		}
	}
	misc_deregister(&server_device);
	gpiochip_remove(&reset_chip);
}

static int __init feet_adapter_init(void)
{
	int error = gpiochip_add_data(&reset_chip, NULL);
	struct bus *bus;

	if (error)
		return error;
	error = misc_register(&server_device);
	if (error) {
		gpiochip_remove(&reset_chip);
		return error;
	}
	for_each_bus(bus)
		if (!error)
			error = add_adapter(bus);
	if (error)
		remove_all();
	return error;
}

module_init(feet_adapter_init);
module_exit(remove_all);

MODULE_DESCRIPTION("I2C adapters whose transfers a program in user space answers");
MODULE_LICENSE("GPL");
