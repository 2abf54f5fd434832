"""rsoconsole on Raspberry Pi OS as far as an emulator can show it: Debian for ARM under QEMU."""
