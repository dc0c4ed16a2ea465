// SPDX-License-Identifier: Apache-2.0
#include "detect/class_kinds.h"

#include <algorithm>

namespace stillmap {

namespace {

bool has(const std::vector<std::string>& list, const std::string& name) {
  return std::find(list.begin(), list.end(), name) != list.end();
}

}  // namespace

std::vector<ClassKind> class_kinds(const Config::Classes& classes) {
  std::vector<ClassKind> kinds;
  for (const std::string& name : classes.names) {
    kinds.push_back(has(classes.dynamic, name)       ? ClassKind::Dynamic
                    : has(classes.semi_static, name) ? ClassKind::SemiStatic
                    : has(classes.pure_static, name) ? ClassKind::Static
                                                     : ClassKind::Ignored);
  }
  return kinds;
}

std::string class_warning(const Config::Classes& classes) {
  std::string unknown;
  for (const auto* list : {&classes.dynamic, &classes.semi_static, &classes.pure_static}) {
    for (const std::string& name : *list) {
      if (!has(classes.names, name)) unknown += (unknown.empty() ? "'" : ", '") + name + "'";
    }
  }
  if (unknown.empty()) return {};
  return "the model does not know the classes " + unknown +
         "; correct their spelling after classes.names, or remove them";
}

}  // namespace stillmap
