// The Falcon's packets, its firmware files, and SHA-256.
#include "device/falcon/falcon_packets.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <initializer_list>
#include <limits>
#include <numbers>

#include "device/falcon/falcon_boot.h"
#include "device/falcon/falcon_device.h"
#include "tests/device/helpers.h"
#include "tests/device/mock/falcon_board.h"
#include "tests/files.h"
#include "toolkit/core/random.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data,
                                      std::size_t size);  // tests/fuzz/fuzz_falcon.cpp

namespace palpate::device {
namespace {

std::string text_of(const FalconBytes& bytes) {
  return {bytes.begin(), bytes.end()};
}

FalconBytes bytes_of(const std::string& text) {
  FalconBytes bytes{};
  std::copy(text.begin(), text.end(), bytes.begin());
  return bytes;
}

TEST(FalconPackets, WhatLetsGoIsKnownByItsMotors) {
  for (const std::uint8_t flags : std::initializer_list<std::uint8_t>{0, 1, 5, 9}) {
    EXPECT_TRUE(falcon_lets_go(encoded(FalconCommand{{}, flags})));
    for (std::size_t motor = 0; motor < 3; ++motor) {
      FalconCommand command{{}, flags};
      command.motors[motor] = motor == 1 ? -1 : 1;
      EXPECT_FALSE(falcon_lets_go(encoded(command)));
    }
  }
  FalconBytes damaged = encoded(FalconCommand{});
  damaged[0] = '>';
  EXPECT_FALSE(falcon_lets_go(damaged));
  EXPECT_FALSE(falcon_lets_go(std::span(damaged).first(15)));
  EXPECT_FALSE(falcon_lets_go({}));
}

TEST(FalconPackets, KnownOnes) {
  FalconCommand idle;
  idle.flags = 0;
  EXPECT_EQ(text_of(encoded(idle)), "<AAAAAAAAAAAAAA>");
  // The published walk-through: JFKP are the nibbles 9, 5, A, F of 0xFA59.
  const auto reply = falcon_reply(bytes_of("<JFKPAAAABAAAAA>")).value();
  EXPECT_EQ(reply.counts, (std::array<std::int16_t, 3>{-1447, 0, 1}));
  const FalconCommand command{{-1447, 4095, -4095}, FalconCommand::kHoming | FalconCommand::kRed};
  EXPECT_EQ(text_of(encoded(command)), "<JFKPPPPABAAPJA>");
  EXPECT_EQ(falcon_command(encoded(command)), command);
}

TEST(FalconPackets, AHomedReplyIsAbove0x7FAndRead) {
  const FalconReply reply{{1, -2, 300}, 0xF, FalconReply::kAllLegs};
  const FalconBytes bytes = encoded(reply);
  EXPECT_EQ(bytes[13], 0x41 + 0x7F);
  EXPECT_EQ(falcon_reply(bytes), reply);
  FalconBytes beyond = bytes;
  ++beyond[13];
  EXPECT_FALSE(falcon_reply(beyond));
}

TEST(FalconPackets, MotorsAreHeldAtTheirLimitAndNeverWrap) {
  for (const int asked : {4096, 32768, 40000, 65536, 1'000'000, std::numeric_limits<int>::max()}) {
    EXPECT_EQ(falcon_command(encoded(FalconCommand{{asked, -asked, 0}, 1}))->motors,
              (std::array<int, 3>{4095, -4095, 0}));
  }
}

TEST(FalconPackets, SaturationKeepsTheDirection) {
  EXPECT_EQ(falcon_motors(Vec3{1.0, -2.0, 0.05}, 10.0), (std::array<int, 3>{-10, 20, -1}));
  const auto motors = falcon_motors(Vec3{1000.0, -400.0, 200.0}, 10.0);
  EXPECT_EQ(motors, (std::array<int, 3>{-4095, 1638, -819}));
  EXPECT_EQ(falcon_motors(Vec3{1e300, 0.0, 1e300}, 1e9), (std::array<int, 3>{}));  // infinite: none
  EXPECT_EQ(falcon_motors(Vec3{std::nan(""), 0.0, 0.0}, 10.0), (std::array<int, 3>{}));
}

FalconReply any_reply(Random& random) {
  FalconReply reply;
  for (std::int16_t& count : reply.counts)
    count = static_cast<std::int16_t>(static_cast<int>(random.below(65536)) - 32768);
  reply.buttons = static_cast<std::uint8_t>(random.below(16));
  reply.homed = static_cast<std::uint8_t>(random.below(8));
  return reply;
}

TEST(FalconReader, FindsEveryReplyHoweverTheStreamIsTornAndDirty) {
  expect_found_in_dirt<FalconReader>('<', any_reply);
}

TEST(FalconReader, AReplyBehindATornOneIsFoundAndTheDamageCounted) {
  Random random(5);
  const FalconReply whole = any_reply(random);
  const FalconBytes bytes = encoded(whole);
  for (std::size_t kept = 1; kept < kFalconPacketBytes; ++kept) {
    FalconReader reader;
    int found = 0;
    for (std::size_t i = 0; i < kept; ++i) EXPECT_FALSE(reader.take(bytes[i]));
    for (int times = 0; times < 2; ++times)
      for (const std::uint8_t byte : bytes)
        if (const auto reply = reader.take(byte)) found += *reply == whole ? 1 : 0;
    EXPECT_EQ(found, 2) << kept;
    EXPECT_EQ(reader.malformed(), 1u);
    EXPECT_EQ(reader.malformed_in_a_row(), 0u);
    EXPECT_EQ(reader.dropped(), kept);
  }
}

TEST(FalconFirmware, AWholeImageIsTaken) {
  const auto image = value_of(check_falcon_firmware(made_up_image(3, 200)));
  EXPECT_EQ(image.entry, 0x3F8002u);
  EXPECT_EQ(image.blocks, 3u);
  EXPECT_EQ(image.words, 600u);
  EXPECT_EQ(image.name, "unknown image");
  EXPECT_EQ(image.sha256.size(), 64u);
}

TEST(FalconFirmware, EveryShorterAndLongerFileIsRefused) {
  const std::vector<std::uint8_t> whole = made_up_image(2, 5);
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_FALSE(check_falcon_firmware({whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)}))
        << size;
  std::vector<std::uint8_t> longer = whole;
  longer.push_back(0);
  EXPECT_FALSE(check_falcon_firmware(longer));
}

TEST(FalconFirmware, SaysWhatIsWrongAndWhere) {
  const auto problem = [](std::size_t at, std::uint8_t value) {
    std::vector<std::uint8_t> bytes = made_up_image(2, 5);
    bytes[at] = value;
    const auto image = check_falcon_firmware(bytes);
    return image ? std::string("fine") : image.error().what;
  };
  EXPECT_TRUE(says(problem(0, 0xAB), "key AA 08 is missing at byte 0")) << problem(0, 0xAB);
  EXPECT_TRUE(says(problem(18, 0x40), "entry"));
  EXPECT_TRUE(says(problem(24, 0x40), "addresses that the processor does not have"));
  EXPECT_TRUE(says(problem(22, 200), "ends within a block"));
  EXPECT_EQ(problem(30, 0x77), "fine") << "a word's value is anybody's";
  // The last address that there is, and one more.
  std::vector<std::uint8_t> edge = made_up_image(1, 5);
  edge[24] = 0x3F, edge[25] = 0, edge[26] = 0xFB, edge[27] = 0xFF;
  EXPECT_TRUE(check_falcon_firmware(edge));
  edge[26] = 0xFC;
  EXPECT_FALSE(check_falcon_firmware(edge));
  EXPECT_FALSE(check_falcon_firmware(made_up_image(0, 0))) << "no block at all";
}

class FirmwareFolder : public InFolder {
 protected:
  FirmwareFolder() {
    for (const char* const name : {"a", "b"}) std::filesystem::create_directory(folder_ / name);
  }
  void write(const std::string& name, const std::vector<std::uint8_t>& bytes) const {
    std::ofstream out(folder_ / name, std::ios::binary);
    out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  }
};

TEST_F(FirmwareFolder, IsSearchedInOrder) {
  FalconFirmwarePlaces places{"", "", {folder_ / "missing", folder_ / "a", folder_ / "b"}};
  const auto nothing = find_falcon_firmware(places);
  ASSERT_FALSE(nothing);
  EXPECT_TRUE(says(nothing.error().remedy, "firmware=FILE"));
  EXPECT_TRUE(says(nothing.error().remedy, in("a"))) << "where to put it";
  write("b/second.bin", made_up_image(2, 9));
  EXPECT_EQ(find_falcon_firmware(places)->path, in("b/second.bin"));
  write("a/readme.txt", {1});
  write("a/broken.bin", {1, 2, 3});
  EXPECT_EQ(find_falcon_firmware(places)->path, in("b/second.bin")) << "what is no image is passed over";
  write("a/z.bin", made_up_image(1, 9));
  write("a/y.bin", made_up_image(1, 8));
  EXPECT_EQ(find_falcon_firmware(places)->path, in("a/y.bin"));
  places.variable = in("a/z.bin");
  EXPECT_EQ(find_falcon_firmware(places)->path, in("a/z.bin"));
  places.file = in("b/second.bin");
  EXPECT_EQ(find_falcon_firmware(places)->path, in("b/second.bin"));
  places.file = in("a/broken.bin");
  const auto named = find_falcon_firmware(places);
  ASSERT_FALSE(named) << "a file that was named is this or none";
  EXPECT_EQ(named.error().file, in("a/broken.bin"));
  places = {"", "", {folder_ / "a"}};
  std::filesystem::remove(folder_ / "a/y.bin");
  std::filesystem::remove(folder_ / "a/z.bin");
  EXPECT_EQ(find_falcon_firmware(places).error().file, in("a/broken.bin")) << "nothing else was there";
}

TEST_F(FirmwareFolder, PlacesComeFromTheEnvironment) {
  const Environment home("XDG_DATA_HOME", in("a").c_str());
  const FalconFirmwarePlaces places = falcon_firmware_places("one.bin");
  EXPECT_EQ(places.file, "one.bin");
  ASSERT_EQ(places.folders.size(), 3u);
  EXPECT_EQ(places.folders[0], folder_ / "a/palpate/falcon");
  EXPECT_EQ(places.folders[2], "/lib/firmware/novint");
}

TEST(FalconFuzz, TheCorpusIsRead) {
  expect_corpus_passes(&LLVMFuzzerTestOneInput, PALPATE_SOURCE_ROOT "/tests/corpus/falcon", 8);
  Random random(17);
  for (int run = 0; run < 2000; ++run) {
    const std::vector<std::uint8_t> stream = torn_stream(random, '<', any_reply);
    ASSERT_EQ(LLVMFuzzerTestOneInput(stream.data(), stream.size()), 0) << "seed 17, run " << run;
  }
}

// ---- The Falcon's arm against published and computed numbers, against itself, and against finite
// differences.

constexpr double kDegrees = 180.0 / std::numbers::pi;
const Vec3 kCentre{0.0, 0.0, kFalconCentreMm};

Vec3 in_sphere(Random& random, double radius_mm) {
  for (;;) {
    const Vec3 place{2.0 * random.uniform() - 1.0, 2.0 * random.uniform() - 1.0,
                     2.0 * random.uniform() - 1.0};
    if (place.norm() <= 1.0) return kCentre + radius_mm * place;
  }
}

struct Known {
  Vec3 place_mm, angles_degrees, counts;
};

TEST(FalconKinematics, KnownPoses) {
  const std::array<Known, 3> known = {
      Known{{0, 0, 130}, {31.494, 31.494, 31.494}, {-96.2, -96.2, -96.2}},
      Known{{20, -30, 130}, {54.982, 20.707, 32.814}, {548.4, -392.3, -60.0}},
      Known{{-25, 15, 105}, {-0.064, 34.838, 12.046}, {-962.4, -4.5, -630.0}}};
  for (const Known& one : known) {
    const auto angles = falcon_angles(one.place_mm).value();
    EXPECT_LT((kDegrees * angles - one.angles_degrees).cwiseAbs().maxCoeff(), 0.0006);
    EXPECT_LT((falcon_counts_of_angles(angles) - one.counts).cwiseAbs().maxCoeff(), 0.06);
    const FalconPose pose = falcon_position(angles, kCentre);
    EXPECT_TRUE(pose.converged);
    EXPECT_LT((pose.position_mm - one.place_mm).norm(), 1e-6);
  }
  EXPECT_NEAR(kDegrees * falcon_angles_of_counts(Vec3{1, 0, 0}).x(), 35.036435, 1e-6);
}

TEST(FalconKinematics, JacobianAndTorquesAtTheCentre) {
  const Vec3 angles = falcon_angles(kCentre).value();
  const Mat3 jacobian = falcon_jacobian(kCentre, angles).value();
  Mat3 known;
  known << 0.002967, -0.009864, 0.013238, -0.010026, 0.002363, 0.013238, 0.007059, 0.007501, 0.013238;
  EXPECT_LT((jacobian - known).cwiseAbs().maxCoeff(), 6e-7);
  EXPECT_LT((falcon_torques(jacobian, Vec3{1, 0, 0}).value() - Vec3(18.64, -62.99, 44.35)).norm(), 0.02);
  EXPECT_LT((falcon_torques(jacobian, Vec3{0, 0, 1}).value() - Vec3(25.18, 25.18, 25.18)).norm(), 0.02);
}

TEST(FalconKinematics, ThereAndBackOverTheWorkspace) {
  Random random(41);
  double worst_rad = 0.0, worst_mm = 0.0;
  int most_steps = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Vec3 place = in_sphere(random, 50.0);
    const Vec3 angles = falcon_angles(place).value();
    const FalconPose pose = falcon_position(angles, kCentre);
    ASSERT_TRUE(pose.converged) << "seed 41, case " << i;
    worst_rad = std::max(worst_rad, (falcon_angles(pose.position_mm).value() - angles).cwiseAbs().maxCoeff());
    worst_mm = std::max(worst_mm, (pose.position_mm - place).norm());
    most_steps = std::max(most_steps, pose.steps);
    // From where it was a frame ago.
    const FalconPose near = falcon_position(angles, place + 0.9 * (in_sphere(random, 1.0) - kCentre));
    ASSERT_TRUE(near.converged && near.steps <= 4) << "seed 41, case " << i;
  }
  EXPECT_LT(worst_rad, 1e-9);
  EXPECT_LT(worst_mm, 2e-7);
  EXPECT_LE(most_steps, kFalconNewtonSteps / 2);
  RecordProperty("worst_angle_rad", std::to_string(worst_rad));
  std::printf("worst after there and back: %.1e rad, %.1e mm; at most %d steps\n", worst_rad, worst_mm,
              most_steps);
}

TEST(FalconKinematics, JacobianIsTheDerivative) {
  Random random(43);
  constexpr double kStep = 1e-4;  // mm: the error of central differences, and that of rounding, below 1e-10
  double worst = 0.0;
  for (int i = 0; i < 2000; ++i) {
    const Vec3 place = in_sphere(random, 50.0);
    const Mat3 jacobian = falcon_jacobian(place, falcon_angles(place).value()).value();
    for (int axis = 0; axis < 3; ++axis) {
      const Vec3 step = kStep * Vec3::Unit(axis);
      const Vec3 slope =
          (falcon_angles(place + step).value() - falcon_angles(place - step).value()) / (2.0 * kStep);
      worst = std::max(worst, (slope - jacobian.col(axis)).cwiseAbs().maxCoeff());
    }
  }
  EXPECT_LT(worst, 1e-10) << "rad/mm, seed 43";
  std::printf("worst difference to finite differences: %.1e rad/mm\n", worst);
}

TEST(FalconKinematics, TorquesDoTheWorkOfTheForce) {
  Random random(47);
  for (int i = 0; i < 1000; ++i) {
    const Vec3 place = in_sphere(random, 40.0);
    const Mat3 jacobian = falcon_jacobian(place, falcon_angles(place).value()).value();
    const Vec3 force = in_sphere(random, 5.0) - kCentre, motion = in_sphere(random, 1.0) - kCentre;
    const Vec3 torques = falcon_torques(jacobian, force).value();
    ASSERT_NEAR(torques.dot(jacobian * motion), force.dot(motion), 1e-9) << "seed 47, case " << i;
  }
}

TEST(FalconKinematics, OutOfReachIsSaidAndBounded) {
  EXPECT_FALSE(falcon_angles(Vec3{0, 0, 400}));
  EXPECT_FALSE(falcon_angles(Vec3{200, 0, 130}));
  EXPECT_FALSE(falcon_angles(Vec3::Constant(std::nan(""))));
  EXPECT_FALSE(falcon_position(Vec3::Constant(std::nan("")), kCentre).converged);
  EXPECT_FALSE(falcon_position(Vec3::Zero(), Vec3{0, 0, 400}).converged);
  EXPECT_FALSE(falcon_torques(Mat3::Zero(), Vec3{1, 0, 0}));
  // Any counts that a packet can hold: a place whose angles these are, or none. Never anything else.
  Random random(53);
  int found = 0;
  for (int i = 0; i < 20'000; ++i) {
    const double most = i % 2 == 0 ? 32768.0 : 3000.0;
    const Vec3 counts{most * (2.0 * random.uniform() - 1.0), most * (2.0 * random.uniform() - 1.0),
                      most * (2.0 * random.uniform() - 1.0)};
    const Vec3 angles = falcon_angles_of_counts(counts);
    const FalconPose pose = falcon_position(angles, kCentre);
    ASSERT_LE(pose.steps, kFalconNewtonSteps);
    ASSERT_TRUE(is_finite(pose.position_mm));
    if (!pose.converged) continue;
    ++found;
    ASSERT_LT((falcon_angles(pose.position_mm).value() - angles).cwiseAbs().maxCoeff(), 1e-9);
    ASSERT_GT(pose.position_mm.z(), 0.0);
  }
  EXPECT_GT(found, 1000);
  EXPECT_LT(found, 19'000);
}

}  // namespace
}  // namespace palpate::device
