#include <gtest/gtest.h>

#include <algorithm>

#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "tests/toolkit/stream/stream_files.h"

#include "toolkit/render/depth_camera.h"
#include "toolkit/stream/camera_files.h"
#include "toolkit/stream/depth_source.h"

namespace palpate::stream {
namespace {

using palpate::test::contains;
using palpate::test::png_of;
using palpate::test::pose_text;
using palpate::test::ramp;
using palpate::test::refused;
using palpate::test::value_of;
using palpate::test::write_text;

class DepthFolder : public InFolder {
 protected:
  [[nodiscard]] std::unique_ptr<DepthSource> open(const DepthSourceOptions& options = {}) const {
    return value_of(open_depth_source(folder_.string(), options));
  }
  void write(const std::string& name, const std::string& text) const { write_text(in(name), text); }
};

std::vector<DepthFrame> all_of(DepthSource& source) {
  std::vector<DepthFrame> frames;
  DepthFrame frame;
  while (value_of(source.next(frame))) frames.push_back(frame);
  return frames;
}

TEST_F(DepthFolder, TumsLayoutHasTimesAndPosesBetween) {
  write("depth.txt", "# depth\n10.0 depth/a.png\n10.04 depth/b.png\n10.08 depth/c.png\n11.0 depth/d.png\n");
  write("groundtruth.txt",
        "# t\n9.99 1 0 0 0 0 0 1\n10.01 1.2 0 0 0 0 0 1\n10.04 2 0 0 0 0 0.70710678 0.70710678\n"
        "10.09 2 0 0 0 0 0 1\n");
  for (const char* name : {"a", "b", "c", "d"})
    write(std::string("depth/") + name + ".png", png_of(ramp(16, 12, 5000)));
  const auto source = open();
  EXPECT_EQ(source->camera().width, 16);
  EXPECT_DOUBLE_EQ(source->camera().fx_px, 525.0 * 16 / 640);
  EXPECT_NEAR(source->camera().cx_px, 7.5, 1e-12);
  EXPECT_NEAR(source->camera().period_s, 0.04, 1e-9);
  EXPECT_TRUE(contains(source->describe(), "TUM", "3 frames", "1 images without a pose"));
  const auto frames = all_of(*source);
  ASSERT_EQ(frames.size(), 3u);
  EXPECT_NEAR(frames[1].captured_s, 0.04, 1e-9);
  EXPECT_NEAR(frames[0].world_from_camera.translation_mm.x(), 1100.0, 1e-6);
  EXPECT_LT((frames[1].world_from_camera.rotate(Vec3::UnitX()) - Vec3::UnitY()).norm(), 1e-6);
  // A fifth from b's quarter turn is left at 10.08: 4/5 of the way to c's.
  EXPECT_NEAR(Eigen::AngleAxisd(frames[2].world_from_camera.rotation).angle(), M_PI / 10, 1e-6);
  EXPECT_EQ(frames[0].depth_mm[0], 0.0f);
  EXPECT_FLOAT_EQ(frames[0].depth_mm[1], 1000.2f);
  ASSERT_TRUE(source->restart());
  EXPECT_EQ(all_of(*source).size(), 3u);
}

TEST_F(DepthFolder, Open3dsLayoutHasALogAndAJsonOfIntrinsics) {
  for (const char* name : {"0", "1", "2"}) write(std::string("depth/") + name + ".png", png_of(ramp(16, 12)));
  write("trajectory.log", "0 0 1\n" + pose_text(0, 0, 0) + "1 1 2\n" + pose_text(0.5, 0, -1));
  write("camera_intrinsic.json",
        R"({"width":16,"height":12,"intrinsic_matrix":[20.5,0,0,0,21.5,0,7.25,5.25,1]})");
  const auto source = open({.unit_mm_per_count = 0.5, .rate_hz = 10.0});
  EXPECT_TRUE(contains(source->describe(), "Open3D", "1 images without a pose", "camera_intrinsic.json"));
  EXPECT_EQ(source->camera().fx_px, 20.5);
  EXPECT_EQ(source->camera().cy_px, 5.25);
  const auto frames = all_of(*source);
  ASSERT_EQ(frames.size(), 2u);
  EXPECT_EQ(frames[1].world_from_camera.translation_mm, Vec3(500.0, 0.0, -1000.0));
  EXPECT_NEAR(frames[1].captured_s, 0.1, 1e-12);
  EXPECT_EQ(frames[1].arrived_s, frames[1].captured_s);
  EXPECT_FLOAT_EQ(frames[0].depth_mm[1], 500.5f);
}

TEST_F(DepthFolder, TsdfsLayoutKeepsNumbersAndGoesOnAfterADamagedPose) {
  write("camera-intrinsics.txt", "5.85e+02 0 3.2e+02\n0 5.85e+02 2.4e+02\n0 0 1\n");
  for (const char* number : {"000150", "000151", "000153"}) {
    write(std::string("frame-") + number + ".depth.png", png_of(ramp(16, 12)));
    write(std::string("frame-") + number + ".pose.txt", pose_text(1, 2, 3));
  }
  write("frame-000151.pose.txt", "nan nan nan nan\n");
  const auto source = open();
  EXPECT_EQ(source->camera().cx_px, 320.0);
  DepthFrame frame;
  ASSERT_TRUE(value_of(source->next(frame)));
  EXPECT_EQ(frame.number, 0u);
  EXPECT_TRUE(refused(source->next(frame), "frame-000151.pose.txt", "no pose"));
  ASSERT_TRUE(value_of(source->next(frame)));
  EXPECT_EQ(frame.number, 3u);
  EXPECT_NEAR(frame.captured_s, 0.1, 1e-12);
  EXPECT_FALSE(value_of(source->next(frame)));
}

TEST_F(DepthFolder, NumbersWithoutZerosInFrontAreInOrder) {
  for (const int number : {0, 1, 2, 9, 10, 11, 100})
    write(fmt::format("{}.png", number), png_of(ramp(4, 3, static_cast<std::uint16_t>(1000 + number))));
  std::vector<float> firsts;
  for (const DepthFrame& frame : all_of(*open())) firsts.push_back(frame.depth_mm[1]);
  EXPECT_EQ(firsts, (std::vector<float>{1001, 1002, 1003, 1010, 1011, 1012, 1101}));
}

TEST_F(DepthFolder, WithoutPosesTheCameraStandsStill) {
  write("0.png", png_of(ramp(16, 12)));
  EXPECT_TRUE(contains(open()->describe(), "stands still", "assumed"));
}

TEST_F(DepthFolder, RefusesWhatItCannotRead) {
  EXPECT_TRUE(refused(open_depth_source(folder_.string()), "no depth images", "depth.txt"));
  EXPECT_TRUE(refused(open_depth_source(in("nothing")), "no stream", "sim:NAME"));
  EXPECT_TRUE(refused(open_depth_source("sim:wal"), "did you mean 'wall'"));
  EXPECT_TRUE(refused(open_depth_source("sim:wall:hz=2"), "no option 'hz'"));
  EXPECT_TRUE(refused(open_depth_source(folder_.string(), {.unit_mm_per_count = -1.0}), "unit"));
  EXPECT_TRUE(refused(open_depth_source(folder_.string(), {.rate_hz = HUGE_VAL}), "rate"));
  write("0.png", "no picture");
  EXPECT_TRUE(refused(open_depth_source(folder_.string()), "0.png", "no PNG"));
  const std::vector<std::uint8_t> grey(16 * 12, 7);
  write("0.png", png_of(grey.data(), 16, 12, PNG_FORMAT_GRAY));
  EXPECT_TRUE(refused(open_depth_source(folder_.string()), "0.png", "16-bit grey"));
  write("0.png", png_of(ramp(16, 12)));
  write("camera.json", R"({"width":640,"height":480,"intrinsic_matrix":[1,0,0,0,1,0,0,0,1]})");
  EXPECT_TRUE(refused(open_depth_source(folder_.string()), "16 x 12", "640 x 480"));
  write("camera.json", R"({"width":16,"height":12,"intrinsic_matrix":[0,0,0,0,1,0,0,0,1]})");
  EXPECT_TRUE(refused(open_depth_source(folder_.string()), "camera.json", "focal"));
  write("camera.json", "{");
  EXPECT_TRUE(refused(open_depth_source(folder_.string()), "camera.json", "intrinsic_matrix"));
  std::filesystem::remove(in("camera.json"));
  write("trajectory.log", "0 0 1\n1 0 0 0\n0 1 0 0\n0 0 5 0\n0 0 0 1\n");
  EXPECT_TRUE(refused(open_depth_source(folder_.string()), "trajectory.log:5", "no pose"));
}

TEST_F(DepthFolder, AnotherSizeLaterIsAnErrorOfThatImage) {
  write("0.png", png_of(ramp(16, 12)));
  write("1.png", png_of(ramp(12, 16)));
  write("2.png", png_of(ramp(16, 12)));
  const auto source = open();
  DepthFrame frame;
  ASSERT_TRUE(value_of(source->next(frame)));
  EXPECT_TRUE(refused(source->next(frame), "1.png", "12 x 16"));
  ASSERT_TRUE(value_of(source->next(frame)));
  EXPECT_EQ(frame.number, 2u);
}

TEST(DepthPng, EveryTruncationIsRefused) {
  const std::string file = png_of(ramp(40, 30));
  DepthImage image;
  test::each_cut(file, file.size() - 12, [&](const std::string& cut) {  // the last chunk ends the file alone
    EXPECT_TRUE(refused(read_depth_png(test::bytes_of(cut), {}, image)));
  });
  ASSERT_TRUE(read_depth_png(test::bytes_of(file), {40, 30}, image));
  EXPECT_EQ(image.counts, ramp(40, 30).counts);
}

TEST(DepthPng, AHeaderThatPromisesTooMuchTakesNoMemory) {
  std::string file = png_of(ramp(8, 8));
  // Width and height begin at byte 16; the checksum of the header (CRC-32), at 29, is made to fit.
  for (const std::size_t side : {std::size_t{16}, std::size_t{20}}) file.replace(side, 4, {0, 0, 0x1F, 0});
  const std::string head = file.substr(12, 17);
  std::uint32_t sum = 0xFFFFFFFFu;
  for (const char c : head) {
    sum ^= static_cast<std::uint8_t>(c);
    for (int bit = 0; bit < 8; ++bit) sum = (sum >> 1) ^ (0xEDB88320u & (0u - (sum & 1u)));
  }
  sum = ~sum;
  for (std::size_t i = 0; i < 4; ++i) file[29 + i] = static_cast<char>(sum >> (24 - 8 * i));
  DepthImage image;
  EXPECT_TRUE(refused(read_depth_png(test::bytes_of(file), {}, image), "cannot hold 7936 x 7936"));
  EXPECT_EQ(image.counts.capacity(), 0u);
}

TEST(PoseFiles, ReadWhatTheirFormatsSay) {
  const auto cut = parse_timed_poses("0 0 0 0 0 0 0 1\n1 2 3\n");
  ASSERT_TRUE(refused(cut, "the line is no pose"));
  EXPECT_EQ(cut.error().line, 2);
  EXPECT_TRUE(refused(parse_timed_poses("0 0 0 0 0 0 0 0\n"), "no pose"));
  EXPECT_TRUE(refused(parse_timed_files("1.0\n"), "the line names no image"));
  EXPECT_TRUE(refused(parse_pose("1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n"), "no pose"));  // a mirror
  const auto sorted = value_of(parse_timed_poses("2 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n"));
  EXPECT_EQ(sorted.front().t_s, 1.0);
  EXPECT_FALSE(pose_at({}, 0.0));
  EXPECT_FALSE(pose_at(sorted, 1.5)) << "a second apart";
  EXPECT_FALSE(pose_at(sorted, 0.9));
  EXPECT_TRUE(pose_at(sorted, 0.96));
  DepthCamera camera;
  ASSERT_TRUE(parse_intrinsics("517.3 516.5 318.6 255.3 0.2624 -0.9531 -0.0054 0.0026 1.1633\n", camera));
  EXPECT_EQ(camera.fy_px, 516.5);
  EXPECT_EQ(camera.distortion[4], 1.1633);
  EXPECT_TRUE(refused(parse_intrinsics("1 2\n", camera), "no intrinsics"));
  EXPECT_TRUE(refused(parse_intrinsics("1 0 0\n0 1 0\n", camera), "ends too early"));
}

TEST(DepthCameraLens, RaysAndPixelsAreInverse) {
  DepthCamera camera;
  camera.fx_px = 517.3;
  camera.distortion = {0.2624, -0.9531, -0.0054, 0.0026, 1.1633};  // TUM's freiburg1
  for (double u = 40.0; u < 600.0; u += 40.0)
    for (double v = 40.0; v < 440.0; v += 40.0) {
      const Eigen::Vector2d back = render::pixel_of(camera, 1234.0 * render::ray_of(camera, u, v));
      EXPECT_LT((back - Eigen::Vector2d(u, v)).norm(), 1e-6) << u << " " << v;
    }
}

/// Median distance along z between a frame's points and another's depths where they fall.
double disagreement_mm(const DepthCamera& camera, const DepthFrame& from, const DepthFrame& to) {
  std::vector<double> off;
  const geometry::RigidTransform to_from = to.world_from_camera.inverse();
  for (int v = 0; v < camera.height; v += 4)
    for (int u = 0; u < camera.width; u += 4) {
      const float z = from.depth_mm[static_cast<std::size_t>(v * camera.width + u)];
      if (!(z > 0.0f)) continue;
      const Vec3 p =
          to_from * (from.world_from_camera * (static_cast<double>(z) * render::ray_of(camera, u, v)));
      if (!(p.z() > 0.0)) continue;
      const Eigen::Vector2d at = render::pixel_of(camera, p);
      const long x = std::lround(at.x()), y = std::lround(at.y());
      if (x < 0 || y < 0 || x >= camera.width || y >= camera.height) continue;
      const float seen = to.depth_mm[static_cast<std::size_t>(y * camera.width + x)];
      if (seen > 0.0f) off.push_back(std::abs(static_cast<double>(seen) - p.z()));
    }
  EXPECT_GT(off.size(), 5000u);
  std::nth_element(off.begin(), off.begin() + static_cast<std::ptrdiff_t>(off.size() / 2), off.end());
  return off[off.size() / 2];
}

TEST(SharedRecordings, OneFrameProjectsIntoAnother) {
  struct Recording {
    const char* folder;
    double most_mm;  ///< a clean rendering; a Kinect at 2 m, with 5 mm of noise and its poses' drift
  };
  for (const auto& [folder, most_mm] : {Recording{"rgbd/livingroom", 3.0}, Recording{"rgbd/tsdf", 15.0}}) {
    const std::string path = shared_data(folder).string();
    if (path.empty()) GTEST_SKIP() << "no " << folder << " in PALPATE_DATA";
    const auto source = value_of(open_depth_source(path));
    DepthFrame first, later;
    ASSERT_TRUE(value_of(source->next(first)));
    for (int i = 0; i < 20; ++i) ASSERT_TRUE(value_of(source->next(later)));
    const DepthCamera& camera = source->camera();
    EXPECT_LT(disagreement_mm(camera, first, later), most_mm) << folder;
    // With another's pose they disagree: the test can fail.
    later.world_from_camera.translation_mm.z() += 50.0;
    EXPECT_GT(disagreement_mm(camera, first, later), 2.0 * most_mm) << folder;
  }
}

#ifdef PALPATE_WITH_PCD
TEST_F(DepthFolder, OrganisedPcdTellsItsCamera) {
  DepthCamera truth;
  truth.width = 20;
  truth.height = 15;
  truth.fx_px = 18.0;
  truth.fy_px = 19.0;
  truth.cx_px = 8.5;
  truth.cy_px = 7.0;
  const auto cloud = [&](double z_m) {
    std::string text = fmt::format(
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 20\nHEIGHT 15\nPOINTS 300\n"
        "DATA ascii\n");
    for (int v = 0; v < truth.height; ++v)
      for (int u = 0; u < truth.width; ++u) {
        const Vec3 p = (z_m + 0.01 * u) * render::ray_of(truth, u, v);
        text += u == 3 ? std::string("nan nan nan\n") : fmt::format("{} {} {}\n", p.x(), p.y(), p.z());
      }
    return text;
  };
  write("0.pcd", cloud(1.0));
  write("1.pcd", cloud(2.0));
  EXPECT_TRUE(refused(open_depth_source(folder_.string()), "0.pcd", "cannot be read by this program"));
  io::Readers readers;
  pcd::add_pcd_reader(readers);
  const auto source = open({.readers = &readers});
  EXPECT_NEAR(source->camera().fx_px, truth.fx_px, 1e-3);
  EXPECT_NEAR(source->camera().fy_px, truth.fy_px, 1e-3);
  EXPECT_NEAR(source->camera().cx_px, truth.cx_px, 1e-3);
  EXPECT_NEAR(source->camera().cy_px, truth.cy_px, 1e-3);
  const auto frames = all_of(*source);
  ASSERT_EQ(frames.size(), 2u);
  EXPECT_EQ(frames[0].depth_mm[3], 0.0f);
  EXPECT_NEAR(frames[1].depth_mm[4], 2040.0f, 0.01f);
  // Points that were turned are no camera's any more.
  std::string turned = cloud(1.0);
  write("0.pcd", turned.replace(turned.find("WIDTH 20\nHEIGHT 15"), 18, "WIDTH 15\nHEIGHT 20"));
  EXPECT_TRUE(refused(open_depth_source(folder_.string(), {.readers = &readers}), "0.pcd", "one camera"));
}

TEST(SharedRecordings, PclsCapturesHaveTheKinectsIntrinsics) {
  const std::string capture = shared_data("pcl/capture0001.pcd").string();
  if (capture.empty()) GTEST_SKIP() << "no pcl/capture0001.pcd in PALPATE_DATA";
  const std::string folder = testing::TempDir() + "/palpate-captures";
  std::filesystem::create_directories(folder);
  std::error_code there;
  std::filesystem::create_symlink(capture, folder + "/capture0001.pcd", there);
  io::Readers readers;
  pcd::add_pcd_reader(readers);
  const auto source = value_of(open_depth_source(folder, {.readers = &readers}));
  EXPECT_NEAR(source->camera().fx_px, 525.0, 0.01);
  EXPECT_NEAR(source->camera().cx_px, 319.5, 0.01);
  EXPECT_NEAR(source->camera().cy_px, 239.5, 0.01);
}
#endif

}  // namespace
}  // namespace palpate::stream
