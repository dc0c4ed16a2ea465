# SPDX-License-Identifier: Apache-2.0
# 32-bit ARM with hard floating point and NEON: the same boards with a 32-bit system.
include(${CMAKE_CURRENT_LIST_DIR}/arm.cmake)
set(CMAKE_SYSTEM_PROCESSOR armv7l)
# Logs and maps may be longer than the 2 GB that a 32-bit offset counts. No notes on how GCC 6 passed arguments.
stillmap_arm_toolchain(armhf arm-linux-gnueabihf qemu-arm -mfpu=neon-fp-armv8 -mfloat-abi=hard -D_FILE_OFFSET_BITS=64 -Wno-psabi)
