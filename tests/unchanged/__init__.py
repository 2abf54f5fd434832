"""What must not change while code is moved and renamed: orders to the mount, figures of nights."""
