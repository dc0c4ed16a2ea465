// SPDX-License-Identifier: Apache-2.0
#include "detect/class_kinds.h"

#include <gmock/gmock.h>

namespace stillmap {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

Config::Classes some_classes() {
  return {{"person", "tv", "cup", "kite"}, {"person"}, {"cup"}, {"tv"}};
}

TEST(ClassKinds, FollowTheOrderOfTheModel) {
  EXPECT_THAT(class_kinds(some_classes()),
              ElementsAre(ClassKind::Dynamic, ClassKind::Static, ClassKind::SemiStatic, ClassKind::Ignored));
}

TEST(ClassKinds, WarnOnceAboutEveryNameTheModelDoesNotKnow) {
  Config::Classes classes = some_classes();
  EXPECT_THAT(class_warning(classes), IsEmpty());
  classes.dynamic.push_back("Person");
  classes.pure_static.push_back("cabinet");
  const std::string line = class_warning(classes);
  EXPECT_THAT(line, HasSubstr("'Person', 'cabinet'"));
  EXPECT_THAT(line, Not(HasSubstr("\n")));
  EXPECT_THAT(line, Not(HasSubstr("'tv'")));
}

}  // namespace
}  // namespace stillmap
