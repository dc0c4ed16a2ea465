// SPDX-License-Identifier: Apache-2.0
#include "runtime/report.h"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>

#include "tests/runtime/pipeline.h"

namespace stillmap {
namespace {

using nlohmann::json;
using test::Pipeline;
using test::wall_driver;
using test::wall_frames;

json report_of(const ReportFacts& facts) {
  auto grabs = wall_frames(8);
  grabs[3].status = GrabStatus::Dropped;
  auto driver = wall_driver(true, grabs);
  Pipeline pipeline(driver);
  run_lockstep(*pipeline.context);
  return json::parse(make_report(*pipeline.context, facts));
}

TEST(Report, CountsAddUp) {
  ReportFacts facts;
  facts.run_start_ns = 1'000'000'000;
  facts.run_end_ns = 3'000'000'000;
  const json r = report_of(facts);
  EXPECT_EQ(r["frames"]["offered"], 8);
  EXPECT_EQ(r["frames"]["processed"], 7);
  EXPECT_EQ(r["frames"]["dropped"], (json{{"corrupt_colour", 1}}));
  EXPECT_EQ(r["tracking"]["tracked"].get<int>() + r["tracking"]["weak"].get<int>(), 7);
  EXPECT_EQ(r["wall_s"], 2);
  EXPECT_EQ(r["throughput_fps"], 3.5);
  EXPECT_EQ(r["detector"]["frames_without_boxes"], 7);
  EXPECT_EQ(r["map"]["frames_fused"], 4);
  EXPECT_EQ(r["memory"]["pools"]["frames"]["refused"], 0);
  EXPECT_FALSE(r.contains("accuracy"));
  const json& pose = r["latency_ms"]["capture_to_pose"];
  EXPECT_GT(pose["p50"], 0);
  EXPECT_LE(pose["p50"], pose["p95"]);
  EXPECT_LE(pose["p95"], pose["p99"]);
  EXPECT_LE(pose["p99"], pose["max"]);
}

TEST(Report, APathThatIsNoUtf8DoesNotCostIt) {
  ReportFacts facts;
  facts.source = "tum:/logs/\xff\xfe";
  EXPECT_EQ(report_of(facts)["source"].get<std::string>().substr(0, 10), "tum:/logs/");
}

TEST(Report, AFigureThatDoesNotExistIsNull) {
  Accuracy accuracy{.ate_rmse_m = 0.25, .matched_poses = 3, .coverage = 1};
  accuracy.rpe_1s_rmse_m = accuracy.rpe_1s_rmse_deg = std::numeric_limits<double>::quiet_NaN();
  const json a = json::parse(accuracy_json(accuracy));
  EXPECT_EQ(a["ate_rmse_m"], 0.25);
  EXPECT_TRUE(a["rpe_1s_rmse_m"].is_null());
  EXPECT_FALSE(a.contains("note"));
  accuracy.coverage = 0.98;
  EXPECT_TRUE(json::parse(accuracy_json(accuracy)).contains("note"));
}

}  // namespace
}  // namespace stillmap
