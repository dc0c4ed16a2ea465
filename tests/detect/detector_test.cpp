// SPDX-License-Identifier: Apache-2.0
#include "detect/detector.h"
#include <gtest/gtest.h>
#include <algorithm>
#include <cstdio>
#include "core/time.h"
#include "detect/model_file.h"
#include "tests/support/read_image.h"
#include "tests/support/shared_folder.h"
namespace stillmap { namespace {
TEST(X, Y) {
  Config c; c = load_config({}, std::vector<std::string>{"camera.width=640","camera.height=480","camera.fx=500","camera.fy=500","camera.cx=320","camera.cy=240","camera.depth_units_per_m=5000"}).value().config;
  auto d = Detector::open(c, test::shared_folder()/"models/nanodet_plus_m/nanodet_plus_m_int8.onnx");
  ASSERT_TRUE(d.ok()) << d.error().message;
  puts(d.value()->describe().c_str());
  std::vector<double> t;
  for (auto& f : test::list_rgbd(test::shared_folder()/"data/fr1_rpy_walkers")) {
    auto im = test::read_colour(f.colour);
    FrameSlot s; s.colour = im.view(); Detections o;
    auto a = monotonic_now();
    ASSERT_TRUE(d.value()->run(s, o));
    t.push_back(to_ms(monotonic_now()-a));
    printf("%s", f.colour.stem().c_str());
    for (auto& i : o.items) if (i.kind == ClassKind::Dynamic||i.kind==ClassKind::SemiStatic) printf(" | %s %.2f %.0f,%.0f,%.0f,%.0f", c.classes.names[i.class_id].c_str(), i.score, i.box.x0,i.box.y0,i.box.x1,i.box.y1);
    puts("");
  }
  std::sort(t.begin(), t.end()); printf("median %.2f min %.2f\n", t[t.size()/2], t[0]);
}
}}
