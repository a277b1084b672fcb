// SPDX-License-Identifier: GPL-2.0
/*
 * An I2C adapter without hardware: a program in user space answers its transfers.
 *
 *   i2c_transfer() -> read() of /dev/feet-adapter    one request
 *                  <- write() to /dev/feet-adapter   its answer
 *
 * Request: struct request_head, n_messages times struct request_message, then the bytes of all written messages.
 * Answer:  struct answer_head, then the bytes of all read messages if the result is not negative.
 *
 * A transfer that is not answered within the adapter's timeout (I2C_TIMEOUT) ends with -ETIMEDOUT, as on a bus whose
 * data line is held. Without a program -ENXIO, without the adapter -ENODEV.
 *
 * /sys/module/feet_adapter/parameters/plugged: 0 takes the adapter away as a pulled USB plug does, 1 adds a new one.
 * A GPIO chip of one line counts the low pulses on it: the RESET pin of a multiplexer.
 */
#include <linux/fs.h>
#include <linux/gpio/driver.h>
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
};

enum stage { IDLE, ASKED, TAKEN, ANSWERED };

static int number = 1;
module_param(number, int, 0444);
MODULE_PARM_DESC(number, "the N of /dev/i2c-N");

/* The transfer under way; `lock` guards all of it, and which adapter is plugged. */
static DEFINE_MUTEX(lock);
static DECLARE_WAIT_QUEUE_HEAD(to_server);
static DECLARE_WAIT_QUEUE_HEAD(to_caller);
static enum stage stage;
static struct i2c_msg *messages;
static int n_messages;
static int result;
static u32 serial;
static bool served;
static struct i2c_adapter *plugged_adapter;

static u32 reset_pulses;
static int reset_level = 1;

/* Ends the transfer under way; the caller holds `lock`. */
static void finish(int with)
{
	result = with;
	stage = ANSWERED;
	wake_up(&to_caller);
}

static int feet_transfer(struct i2c_adapter *adapter, struct i2c_msg *msgs, int n)
{
	size_t bytes = 0;
	int i, ended_with;

	for (i = 0; i < n; i++)
		bytes += msgs[i].len;
	if (n > MAX_MESSAGES || bytes > MAX_BYTES)
		return -EOPNOTSUPP;

	mutex_lock(&lock);
	if (adapter != plugged_adapter || !served) {
		ended_with = adapter != plugged_adapter ? -ENODEV : -ENXIO;
		mutex_unlock(&lock);
		return ended_with;
	}
	messages = msgs;
	n_messages = n;
	serial++;
	stage = ASKED;
	mutex_unlock(&lock);

	wake_up_interruptible(&to_server);
	wait_event_timeout(to_caller, READ_ONCE(stage) == ANSWERED, adapter->timeout);

	mutex_lock(&lock);
	ended_with = stage == ANSWERED ? result : -ETIMEDOUT;
	stage = IDLE;
	messages = NULL;
	mutex_unlock(&lock);
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

static int add_adapter(void)
{
	struct i2c_adapter *adapter = kzalloc(sizeof(*adapter), GFP_KERNEL);
	int error;

	if (!adapter)
		return -ENOMEM;
	adapter->owner = THIS_MODULE;
	adapter->algo = &feet_algorithm;
	adapter->nr = number;
	strscpy(adapter->name, "feet in user space", sizeof(adapter->name));
	mutex_lock(&lock);
	plugged_adapter = adapter;
	mutex_unlock(&lock);
	error = i2c_add_numbered_adapter(adapter);
	if (error == -EBUSY) /* the one before is still open somewhere: the next free number, as for a USB adapter */
		error = i2c_add_adapter(adapter);
	if (error) {
		mutex_lock(&lock);
		plugged_adapter = NULL;
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

static int remove_adapter(void)
{
	struct departure *departure = kzalloc(sizeof(*departure), GFP_KERNEL);

	if (!departure)
		return -ENOMEM;
	INIT_WORK(&departure->work, delete_adapter);
	mutex_lock(&lock);
	departure->adapter = plugged_adapter;
	plugged_adapter = NULL;
	if (stage == ASKED || stage == TAKEN)
		finish(-ENODEV);
	mutex_unlock(&lock);
	queue_work(system_unbound_wq, &departure->work);
	return 0;
}

static int plugged_set(const char *text, const struct kernel_param *parameter)
{
	bool wanted;
	int error = kstrtobool(text, &wanted);

	if (error || wanted == !!plugged_adapter)
		return error;
	return wanted ? add_adapter() : remove_adapter();
}

static int plugged_get(char *text, const struct kernel_param *parameter)
{
	return sysfs_emit(text, "%d\n", !!plugged_adapter);
}

static const struct kernel_param_ops plugged_operations = {
	.set = plugged_set,
	.get = plugged_get,
};
module_param_cb(plugged, &plugged_operations, NULL, 0644);
MODULE_PARM_DESC(plugged, "whether the adapter is there");

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
	mutex_lock(&lock);
	served = false;
	if (stage == ASKED || stage == TAKEN)
		finish(-ENXIO);
	mutex_unlock(&lock);
	return 0;
}

static ssize_t server_read(struct file *file, char __user *to, size_t size, loff_t *position)
{
	struct request_message described;
	struct request_head head;
	ssize_t length = sizeof(head);
	int i;

	do {
		if (wait_event_interruptible(to_server, READ_ONCE(stage) == ASKED))
			return -ERESTARTSYS;
		mutex_lock(&lock);
		if (stage == ASKED)
			break;
		mutex_unlock(&lock); /* it has timed out meanwhile */
	} while (true);

	if (size < sizeof(head) + MAX_MESSAGES * sizeof(described) + MAX_BYTES) {
		mutex_unlock(&lock);
		return -EINVAL;
	}
	head.serial = serial;
	head.reset_pulses = reset_pulses;
	head.n_messages = n_messages;
	if (copy_to_user(to, &head, sizeof(head)))
		goto fault;
	for (i = 0; i < n_messages; i++) {
		described.address = messages[i].addr;
		described.flags = messages[i].flags;
		described.length = messages[i].len;
		described.zero = 0;
		if (copy_to_user(to + length, &described, sizeof(described)))
			goto fault;
		length += sizeof(described);
	}
	for (i = 0; i < n_messages; i++) {
		if (messages[i].flags & I2C_M_RD)
			continue;
		if (copy_to_user(to + length, messages[i].buf, messages[i].len))
			goto fault;
		length += messages[i].len;
	}
	stage = TAKEN;
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
	int i;

	if (size < sizeof(head))
		return -EINVAL;
	if (copy_from_user(&head, from, sizeof(head)))
		return -EFAULT;
	mutex_lock(&lock);
	if (stage != TAKEN || head.serial != serial) { /* too late: the caller has gone */
		mutex_unlock(&lock);
		return size;
	}
	for (i = 0; i < n_messages && head.result >= 0; i++) {
		if (!(messages[i].flags & I2C_M_RD))
			continue;
		if (size - length < messages[i].len ||
		    copy_from_user(messages[i].buf, from + length, messages[i].len)) {
			head.result = -EIO;
			break;
		}
		length += messages[i].len;
	}
	finish(head.result);
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

static int __init feet_adapter_init(void)
{
	int error = gpiochip_add_data(&reset_chip, NULL);

	if (error)
		return error;
	error = misc_register(&server_device);
	if (error)
		goto without_device;
	error = add_adapter();
	if (error)
		goto without_adapter;
	return 0;

without_adapter:
	misc_deregister(&server_device);
without_device:
	gpiochip_remove(&reset_chip);
	return error;
}

/* The module cannot go while an adapter of it is open, so that the plugged one, if any, is free. */
static void __exit feet_adapter_exit(void)
{
	if (plugged_adapter) {
		i2c_del_adapter(plugged_adapter);
		kfree(plugged_adapter);
	}
	misc_deregister(&server_device);
	gpiochip_remove(&reset_chip);
}

module_init(feet_adapter_init);
module_exit(feet_adapter_exit);

MODULE_DESCRIPTION("I2C adapter whose transfers a program in user space answers");
MODULE_LICENSE("GPL");
