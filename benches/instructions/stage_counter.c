// SPDX-License-Identifier: Apache-2.0
// A plugin of QEMU's user emulation that counts a program's instructions by stage: what is executed after a stage's function
// was entered, until another one's is, counts as that stage's. For programs that call their stages in turn on one thread.
//
//   qemu-aarch64 -plugin libstage_counter.so,NAME=SYMBOL,... PROGRAM
//
// Prints a line "NAME calls instructions" for each at exit; "other" is what came before the first.
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

// QEMU's plugin interface, version 1, as far as it is used here (docs/devel/tcg-plugins of QEMU 7.2). QEMU's own header is
// not in Debian.
typedef uint64_t qemu_plugin_id_t;
typedef struct qemu_info_t qemu_info_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
enum { kNoRegisters = 0, kAdd = 0 };
extern void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t, void (*)(qemu_plugin_id_t, struct qemu_plugin_tb*));
extern void qemu_plugin_register_vcpu_tb_exec_cb(struct qemu_plugin_tb*, void (*)(unsigned, void*), int, void*);
extern void qemu_plugin_register_vcpu_tb_exec_inline(struct qemu_plugin_tb*, int, void*, uint64_t);
extern void qemu_plugin_register_atexit_cb(qemu_plugin_id_t, void (*)(qemu_plugin_id_t, void*), void*);
extern size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb*);
extern uint64_t qemu_plugin_tb_vaddr(const struct qemu_plugin_tb*);
extern struct qemu_plugin_insn* qemu_plugin_tb_get_insn(const struct qemu_plugin_tb*, size_t);
extern const char* qemu_plugin_insn_symbol(const struct qemu_plugin_insn*);

#define EXPORTED __attribute__((visibility("default")))
EXPORTED int qemu_plugin_version = 1;

enum { kMostStages = 16 };
static struct Stage {
  char name[32], symbol[256];
  uint64_t entry, calls, instructions;
} stages[kMostStages] = {{.name = "other"}};
static int stage_count = 1;
static struct Stage* current = &stages[0];
static uint64_t executed, executed_before;

static void enter(unsigned cpu, void* stage) {
  (void)cpu;
  current->instructions += executed - executed_before;
  executed_before = executed;
  current = stage;
  ++current->calls;
}

static void translated(qemu_plugin_id_t id, struct qemu_plugin_tb* block) {
  (void)id;
  const char* symbol = qemu_plugin_insn_symbol(qemu_plugin_tb_get_insn(block, 0));
  for (int i = 1; symbol != NULL && i < stage_count; ++i) {
    if (strcmp(symbol, stages[i].symbol) != 0) continue;
    // A function's first block is the first of its blocks that is met.
    if (stages[i].entry == 0) stages[i].entry = qemu_plugin_tb_vaddr(block);
    if (stages[i].entry == qemu_plugin_tb_vaddr(block))
      qemu_plugin_register_vcpu_tb_exec_cb(block, enter, kNoRegisters, &stages[i]);
  }
  qemu_plugin_register_vcpu_tb_exec_inline(block, kAdd, &executed, qemu_plugin_tb_n_insns(block));
}

static void print(qemu_plugin_id_t id, void* unused) {
  (void)id, (void)unused;
  enter(0, &stages[0]);
  for (int i = 0; i < stage_count; ++i)
    fprintf(stderr, "stage %s %llu %llu\n", stages[i].name, (unsigned long long)stages[i].calls,
            (unsigned long long)stages[i].instructions);
}

EXPORTED int qemu_plugin_install(qemu_plugin_id_t id, const qemu_info_t* info, int argc, char** argv) {
  (void)info;
  for (int i = 0; i < argc && stage_count < kMostStages; ++i) {
    const char* equals = strchr(argv[i], '=');
    if (equals == NULL) return -1;
    struct Stage* stage = &stages[stage_count++];
    snprintf(stage->name, sizeof stage->name, "%.*s", (int)(equals - argv[i]), argv[i]);
    snprintf(stage->symbol, sizeof stage->symbol, "%s", equals + 1);
  }
  qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
  qemu_plugin_register_atexit_cb(id, print, NULL);
  return 0;
}
