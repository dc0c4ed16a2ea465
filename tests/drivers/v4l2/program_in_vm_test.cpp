// SPDX-License-Identifier: Apache-2.0
// `stillmap run` on the virtual cameras; see in_vm_test.cpp.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <string>
#include <vector>

#include "drivers/v4l2/v4l2_stream.h"
#include "tests/drivers/v4l2/program_run.h"

namespace {

using nlohmann::json;
using stillmap::test::output;
using stillmap::test::report;
using stillmap::test::sum;
using testing::HasSubstr;

constexpr std::uint32_t kLosePercent = 0x00f0f040, kDisconnect = 0x00f0f041;

void set_control(int file, std::uint32_t id, int value) {
  v4l2_control control{id, value};
  ASSERT_EQ(ioctl(file, VIDIOC_S_CTRL, &control), 0) << id;
}

/// Sets controls, which stay as they are.
void show(const std::string& device, const std::vector<std::string>& controls) {
  const stillmap::Status opened =
      stillmap::V4l2Stream(
          {.device = device, .width = 320, .height = 180, .format = "", .controls = controls})
          .open();
  EXPECT_TRUE(opened.ok()) << opened.error().message;
}

/// A colour camera's node, kept open beside the program for its controls.
class Node {
 public:
  Node() : file_(open("/dev/video0", O_RDWR)) {}
  ~Node() {
    if (file_ >= 0) close(file_);
  }
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;
  int file() const { return file_; }

 private:
  int file_;
};

class VividRun : public stillmap::test::ProgramRun {
 public:
  explicit VividRun(const std::string& more = "camera.give_up_s=30")
      : ProgramRun("v4l2:/dev/video0,/dev/video1",
                   {"camera.width=320", "camera.height=180", "camera.fx=300", "camera.fy=300",
                    "camera.cx=160", "camera.cy=90", "camera.fps=10", "camera.depth_units_per_m=20000",
                    "camera.depth_min_m=0.1", "camera.colour_format=YUYV", "camera.depth_format=Y16",
                    "map.capacity_voxels=100000", "camera.colour_controls=['brightness=77']", more}) {}
};

TEST(Program, WithoutArgumentsItTakesTheFirstCameraAndSaysWhereToLook) {
  show("/dev/video1", {"test_pattern=4", "osd_text_mode=2"});  // squares of colour
  show("/dev/video0",
       {"brightness=128", "contrast=8", "osd_text_mode=2"});  // in the units assumed, bars at 4 to 7.6 m
  stillmap::test::ProgramRun run(std::vector<std::string>{});
  ASSERT_TRUE(run.says("open http://127.0.0.1:8765")) << run.said();
  ASSERT_TRUE(run.says("tracking_started")) << run.said();
  EXPECT_THAT(run.said(), HasSubstr("source: v4l2:/dev/video1,/dev/video0"));
  EXPECT_THAT(run.said(), HasSubstr("no camera profile"));
  constexpr const char* kGet = "/bin/busybox wget -q -O - http://127.0.0.1:8765";
  EXPECT_THAT(output(std::string(kGet) + "/"), HasSubstr("<title>Stillmap</title>"));
  std::string blocks;
  for (int i = 0; i < 60 && blocks.find_first_of("123456789") == std::string::npos; ++i) {
    sleep(1);
    const std::string metrics = output(std::string(kGet) + "/metrics");
    const std::string name = "stillmap_pool_high_water{pool=\"map_blocks\"} ";
    const std::size_t at = metrics.find(name);
    ASSERT_NE(at, std::string::npos) << metrics;
    blocks = metrics.substr(at + name.size(), metrics.find('\n', at) - at - name.size());
  }
  EXPECT_GT(std::stoi(blocks), 0);
  EXPECT_EQ(run.end(SIGTERM), 0) << run.said();
  show("/dev/video1", {"test_pattern=0", "osd_text_mode=0"});
  show("/dev/video0", {"contrast=128", "osd_text_mode=0"});
}

TEST(Program, DevicesAndDoctorKnowTheCameras) {
  EXPECT_THAT(output("/bin/stillmap devices"),
              testing::AllOf(HasSubstr("v4l2:/dev/video1,/dev/video0"), HasSubstr("/dev/video2: vivid")));
  EXPECT_THAT(output("/bin/stillmap doctor || true"), HasSubstr("/dev/video0 can be opened"));
}

TEST(Program, CapturesCountsWhatTheDriverLostAndEndsOnSigterm) {
  Node node;
  set_control(node.file(), kLosePercent, 30);
  VividRun run;
  ASSERT_TRUE(run.says("tracking_started")) << run.said();
  ASSERT_TRUE(run.says("frames dropped: driver_dropped")) << run.said();
  set_control(node.file(), kLosePercent, 0);
  v4l2_control brightness{V4L2_CID_BRIGHTNESS, 0};
  ASSERT_EQ(ioctl(node.file(), VIDIOC_G_CTRL, &brightness), 0);
  EXPECT_EQ(brightness.value, 77) << "as the profile says";
  EXPECT_EQ(run.end(SIGTERM), 0) << run.said();
  const json facts = report();
  const json& frames = facts["frames"];
  EXPECT_EQ(frames["offered"], frames["processed"].get<std::uint64_t>() + sum(frames["dropped"]));
  EXPECT_GT(frames["dropped"]["driver_dropped"], 0);
  EXPECT_EQ(facts["mode"], "live");
  EXPECT_GT(facts["capture"]["cpu_ms_per_frame"], 0);
  EXPECT_LT(facts["capture"]["stamp_to_slot_ms"]["p50"], 60'000) << "both are on one clock";
  for (const char* stage : {"capture", "track", "map", "driver"})
    EXPECT_EQ(facts["memory"]["heap_allocations_after_start"][stage], 0) << stage;
  std::printf("%s capture %s\n", frames.dump().c_str(), facts["capture"].dump().c_str());
}

TEST(Program, ACameraThatComesBackIsFollowedOn) {
  VividRun run;
  ASSERT_TRUE(run.says("tracking_started")) << run.said();
  {
    Node node;
    set_control(node.file(), kDisconnect, 1);
  }
  EXPECT_TRUE(run.says("source_gone")) << run.said();
  EXPECT_TRUE(run.says("source_back")) << run.said();
  EXPECT_EQ(run.end(SIGTERM), 0) << run.said();
}

TEST(Program, ACameraThatIsGoneForGoodEndsTheRun) {
  VividRun run("camera.give_up_s=1");
  ASSERT_TRUE(run.says("tracking_started")) << run.said();
  struct stat before {};
  {
    Node node;
    ASSERT_EQ(fstat(node.file(), &before), 0);
    ASSERT_EQ(unlink("/dev/video0"), 0);
    set_control(node.file(), kDisconnect, 1);
  }
  EXPECT_EQ(run.end(), 1) << run.said();
  EXPECT_THAT(run.said(), HasSubstr("source_refused: try 1: /dev/video0: no such camera"));
  EXPECT_THAT(run.said(), HasSubstr("v4l2:/dev/video0,/dev/video1: the source is gone; check its cable"));
  EXPECT_GT(report()["frames"]["processed"], 0) << "outputs are complete all the same";
  ASSERT_EQ(mknod("/dev/video0", S_IFCHR | 0600, before.st_rdev), 0);
}

}  // namespace
