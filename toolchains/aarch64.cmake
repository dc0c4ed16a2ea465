# SPDX-License-Identifier: Apache-2.0
# 64-bit ARM: Raspberry Pi 3 to 5 and Zero 2, Jetson, RK3588.
include(${CMAKE_CURRENT_LIST_DIR}/arm.cmake)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
# Tests run on the very core that the build is for: an instruction that it lacks stops them.
set(stillmap_emulator qemu-aarch64 -cpu ${STILLMAP_ARM_CPU})
stillmap_arm_toolchain(aarch64 aarch64-linux-gnu "${stillmap_emulator}")
