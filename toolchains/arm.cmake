# SPDX-License-Identifier: Apache-2.0
# What both ARM toolchains share: stillmap_arm_toolchain(NAME TRIPLET EMULATOR CPU_OPTION...).

# The instruction set is stated, never that of the machine that builds. A53 runs on every 64-bit core that came after it.
set(STILLMAP_ARM_CPU cortex-a53 CACHE STRING "Oldest core that the build runs on: cortex-a53, cortex-a72, cortex-a76")
set(CMAKE_TRY_COMPILE_PLATFORM_VARIABLES STILLMAP_ARM_CPU)

macro(stillmap_arm_toolchain name triplet emulator)
  set(CMAKE_SYSTEM_NAME Linux)
  set(CMAKE_C_COMPILER ${triplet}-gcc)
  set(CMAKE_CXX_COMPILER ${triplet}-g++)
  set(CMAKE_LIBRARY_ARCHITECTURE ${triplet})
  string(JOIN " " CMAKE_C_FLAGS_INIT -mcpu=${STILLMAP_ARM_CPU} ${ARGN})
  set(CMAKE_CXX_FLAGS_INIT ${CMAKE_C_FLAGS_INIT})

  if(DEFINED ENV{STILLMAP_SYSROOTS})
    set(CMAKE_SYSROOT $ENV{STILLMAP_SYSROOTS}/${name})
  else()
    set(CMAKE_SYSROOT ${CMAKE_CURRENT_LIST_DIR}/../build/sysroot/${name})
  endif()
  cmake_path(NORMAL_PATH CMAKE_SYSROOT)
  if(NOT EXISTS ${CMAKE_SYSROOT}/pins.txt)
    message(FATAL_ERROR "no libraries to build against in ${CMAKE_SYSROOT}; make them: toolchains/sysroot.sh ${name}")
  endif()
  set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
  set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
  set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
  set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
  set(ENV{PKG_CONFIG_SYSROOT_DIR} ${CMAKE_SYSROOT})
  set(ENV{PKG_CONFIG_LIBDIR} ${CMAKE_SYSROOT}/usr/lib/${triplet}/pkgconfig:${CMAKE_SYSROOT}/usr/share/pkgconfig)
  set(CMAKE_CROSSCOMPILING_EMULATOR ${emulator} -L ${CMAKE_SYSROOT})
endmacro()
