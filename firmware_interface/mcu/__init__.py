"""Reference firmware of board `mcu`, in C; here what makes a file of it for a boot loader."""
