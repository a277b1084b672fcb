"""The page of `footsense view` in a real browser: Debian's Chromium, without a window."""
