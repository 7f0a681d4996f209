// What arms say and hear, to the byte; what is no report; description files and their errors.
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "device/arms/arm_description.h"
#include "tests/device/helpers.h"
#include "tests/device/hid_fake_link.h"
#include "tests/files.h"
#include "toolkit/core/random.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data,
                                      std::size_t size);  // tests/fuzz/fuzz_open_devices.cpp

namespace palpate::device {
namespace {

std::optional<ArmReport> line_of(const std::string& text) {
  return decoded_line({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

TEST(ArmProtocol, KnownReportsHaveTheseBytes) {
  const TestBytes eight = {0x01, 0x00, 0xFE, 0xFF, 0x2C, 0x01, 0x34, 0x12};
  const auto first = decoded_report(ArmForm::kReport8, 0, eight).value();
  EXPECT_EQ(first.counts, (std::array<std::int32_t, 6>{1, -2, 300, 0, 0, 0}));
  EXPECT_EQ(first.counter, 0x1234);
  const auto second =
      decoded_report(ArmForm::kReport14, 64, words({-32768, 32767, 0, 10007, 5, 6, 1}, 64)).value();
  EXPECT_EQ(second.counts, (std::array<std::int32_t, 6>{-32768, 32767, 0, 10007, 5, 6}));
  EXPECT_TRUE(second.calibrate);
  EXPECT_FALSE(decoded_report(ArmForm::kReport14, 0, words({0, 0, 0, 0, 0, 0, 2}))->calibrate);
}

TEST(ArmProtocol, AReportHasItsLengthOrIsNone) {
  for (const ArmForm form : {ArmForm::kReport8, ArmForm::kReport14})
    for (const std::size_t padded : {std::size_t{0}, std::size_t{64}})
      for (std::size_t size = 0; size <= 65; ++size) {
        const bool right = size == (padded == 0 ? report_size(form) : padded);
        EXPECT_EQ(decoded_report(form, padded, TestBytes(size)).has_value(), right) << size;
      }
  EXPECT_FALSE(decoded_report(ArmForm::kText, 0, TestBytes(14)));
}

TEST(ArmProtocol, CommandsHaveTheseBytes) {
  const auto eight = encoded_currents(ArmForm::kReport8, 0, {1, -2, 2000});
  EXPECT_EQ(TestBytes(eight.span().begin(), eight.span().end()), words({1, -2, 2000, 0}));
  const auto padded = encoded_currents(ArmForm::kReport14, 64, {-2000, 0, 7});
  EXPECT_EQ(TestBytes(padded.span().begin(), padded.span().end()), words({-2000, 0, 7}, 64));
  // Command 1: d, e, f where currents stand, 1, then a, b, c.
  const auto counts = encoded_counts(0, {8327, -10926, 19386, 0, 30, 0});
  EXPECT_EQ(TestBytes(counts.span().begin(), counts.span().end()), words({0, 30, 0, 1, 8327, -10926, 19386}));
  const auto text_of = [](const Milliamps& currents) {
    const CommandBytes command = encoded_currents(ArmForm::kText, 0, currents);
    return std::string(command.span().begin(), command.span().end());
  };
  EXPECT_EQ(text_of({}), "[0,0,0]        \n");
  EXPECT_EQ(text_of({1, -2, 345}), "[1,-2,345]     \n");
  EXPECT_EQ(text_of({-32768, -32768, -32768}), "[-32768,-32768,-32768]\n") << "longer than the least";
}

TEST(ArmProtocol, LinesAreReadOrRefused) {
  const auto good = line_of("[1,8312,-10366,19764,0,30,-1,0]").value();
  EXPECT_EQ(good.model, 1);
  EXPECT_EQ(good.counts, (std::array<std::int32_t, 6>{8312, -10366, 19764, 0, 30, -1}));
  EXPECT_EQ(line_of("  [ 1 , 8312,-10366 ,19764,0,30,-1,0 ]  "), good);
  for (const char* bad :
       {"", "[]", "[", "]", "1,2,3,4,5,6,7,8", "[1,2,3,4,5,6,7]", "[1,2,3,4,5,6,7,8,9]", "[1,2,3,4,5,6,7,]",
        "[1,,3,4,5,6,7,8]", "[1,2,3,4,5,6,7,8", "1,2,3,4,5,6,7,8]", "[1,2,3,4,5,6,7,8]x",
        "[1,2.5,3,4,5,6,7,8]", "[1,nan,3,4,5,6,7,8]", "[1,0x10,3,4,5,6,7,8]", "[1,99999999999,3,4,5,6,7,8]",
        "[1,10000001,3,4,5,6,7,8]", "[1,+2,3,4,5,6,7,8]", "[1 2,3,4,5,6,7,8,9]"})
    EXPECT_FALSE(line_of(bad)) << bad;
}

TEST(ArmProtocol, LinesAreFoundInADamagedStream) {
  ArmLineReader reader;
  const auto feed = [&](const std::string& text) {
    int found = 0;
    for (const char c : text) found += reader.take(static_cast<std::uint8_t>(c)).has_value() ? 1 : 0;
    return found;
  };
  EXPECT_EQ(feed("0,0]\n[1,1,2,3,0,0,0,0]\r\n"), 1) << "the first line was torn";
  EXPECT_EQ(reader.malformed_in_a_row(), 0u);
  EXPECT_EQ(feed("\n\n[1,4,5,6,"), 0);
  EXPECT_EQ(reader.malformed_in_a_row(), 0u) << "an empty line is nothing";
  EXPECT_EQ(feed("0,0,0,0]\n"), 1);
  EXPECT_EQ(std::string(reader.line().begin(), reader.line().end()), "[1,4,5,6,0,0,0,0]");
  EXPECT_EQ(feed("noise\nnoise\n[1,2,3]\n"), 0);
  EXPECT_EQ(reader.malformed_in_a_row(), 3u);
  EXPECT_EQ(feed("[1,1,2,3,0,0,0,0]\n"), 1);
  EXPECT_EQ(reader.malformed_in_a_row(), 0u);
  EXPECT_EQ(feed(std::string(10 * ArmLineReader::kMaxLine, 'x')), 0);
  EXPECT_GE(reader.malformed_in_a_row(), 9u) << "a line that never ends";
  EXPECT_EQ(feed("[1,1,2,3,0,0,0,0]\n"), 0) << "the end of that line";
  EXPECT_EQ(feed("[1,1,2,3,0,0,0,0]\n"), 1);
}

TEST(ArmDescription, KnownOnesAreWhatTheirMakersPublished) {
  std::vector<std::string> names;
  for (const KnownArm& known : built_in_arms()) names.push_back(known.name);
  std::sort(names.begin(), names.end());
  EXPECT_EQ(names, (std::vector<std::string>{"polhem-v1", "polhem-v2", "polhem-v3", "polhem-vintage",
                                             "woodenhaptics", "woodenhaptics-serial"}));
  for (const std::string& name : names) {
    const auto arm = value_of(find_arm(name));
    EXPECT_EQ(arm.name, name);
    EXPECT_FALSE(arm.weight) << name << ": unproven";
    EXPECT_LE(arm.current_cap_a, 2.0);
    EXPECT_GT(arm.limits.resolution_mm, 0.005);
    EXPECT_LT(arm.limits.resolution_mm, 0.2);
  }
  // Polhem v3: degrees at the stops of its rest pose as its maker writes them, 120.45, 124.8 and 238.5.
  const ArmDescription third = find_arm("polhem-v3").value();
  const ArmAngles rest = third.angles_of(third.rest_counts);
  constexpr double kDegrees = 57.29577951308232;
  EXPECT_NEAR(rest[0] * kDegrees, 120.45, 0.01);
  EXPECT_NEAR(rest[1] * kDegrees, 124.80, 0.01);
  EXPECT_NEAR(rest[2] * kDegrees, 238.5, 0.1);
  // One N*mm about A takes 28.8534 / 175 of it from the motor, at 60.3 N*mm/A.
  EXPECT_NEAR(third.ma_per_n_mm(0), 1000 * 28.8534 / 175 / 60.3, 1e-9);
  EXPECT_LT(third.ma_per_n_mm(1), 0.0) << "its motor turns against the body";
  // The chains rest with their forearms level, straight ahead; the aluminium one with its forearm hanging.
  for (const char* name : {"woodenhaptics", "woodenhaptics-serial", "polhem-v1"}) {
    const ArmDescription arm = find_arm(name).value();
    const ArmAngles angles = arm.angles_of(arm.rest_counts);
    EXPECT_NEAR(angles[0], 0.0, 1e-12) << name;
    EXPECT_NEAR(angles[1], 0.0, 1e-12) << name;
    EXPECT_NEAR(angles[2] * kDegrees, 90.0, 1e-9) << name;
  }
  const ArmDescription old = find_arm("polhem-vintage").value();
  EXPECT_NEAR(old.angles_of(old.rest_counts)[1] * kDegrees, 90.0, 1e-9);
}

std::string wood_text() {
  for (const KnownArm& known : built_in_arms())
    if (known.name == "woodenhaptics") return std::string(known.text);
  return {};
}

struct WrongDescription {
  const char* from;
  const char* to;
  const char* what;    // part of the message
  const char* remedy;  // part of the message
};

TEST(ArmDescription, WhatIsWrongIsSaidWithFileLineAndRemedy) {
  const WrongDescription wrongs[] = {
      {"form = \"report8\"", "form = \"report9\"", "there is no form", "did you mean 'report8'"},
      {"form = \"report8\"", "form = \"text\"", "'vendor' does nothing here", "leave it out"},
      {"vendor = 0x1234 ", "vendor = 70000", "'vendor'", ""},
      {"vendor = 0x1234 ", "#", "needs 'vendor' and 'product'", "lsusb"},
      {"usage = 0x0200", "usage = 0x0200\nreport_bytes = 7", "'report_bytes' is 7", "8 to 64"},
      {"usage = 0x0200", "usage = 0x0200\nmodel = 1", "'model' does nothing here", "text"},
      {"linkage = \"chain\"", "linkage = \"five-bar\"", "'lengths_mm' must be a list of 6", "crank"},
      {"[80, 205, 245]", "[80, 205]", "'lengths_mm' must be a list of 3", "forearm"},
      {"[80, 205, 245]", "[80, -205, 245]", "above 0", ""},
      {"signs = [1, -1, 1]", "signs = [1, -1, 0]", "'signs' are 1 or -1", "against the body"},
      {"capstan_mm = [10, 10, 10] ", "capstan_mm = [10, 1e9, 10]", "one count would turn joint B",
       "check capstan_mm"},
      {"capstan_mm = [10, 10, 10] ", "capstan_mm = [10, 10]", "list of 3", "A, B, C"},
      {"capstan_mm = [10, 10, 10] ", "capstan_mm = [10, 10, nan]", "finite", ""},
      {"capstan_mm = ", "capstann_mm = ", "capstann_mm", "capstan_mm"},
      {"current_cap_a = 2 ", "current_cap_a = 20", "to 6", "usual amplifiers"},
      {"current_cap_a = 2 ", "current_cap_a = 0", "'current_cap_a'", ""},
      {"when = \"start\"", "when = \"button\"", "calibration button", "start"},
      {"when = \"start\"", "when = \"start\"\nin_firmware = true", "set their counters",
       "without in_firmware"},
      {"angles_deg", "# angles_deg", "either 'counts' or 'angles_deg'", "angles_deg = "},
      {"[0, 0, 90]", "[0, 0, 90]\ncounts = [0, 0, 0]", "either 'counts' or 'angles_deg'", ""},
      {"workspace_low_mm = [-100, -100, -100]", "workspace_low_mm = [100, -100, -100]", "workspace is empty",
       "below"},
      {"force_n = 2.5", "force_n = -5", "'force_n'", ""},
      {"force_n = 2.5", "", "'force_n'", ""},
      {"name = \"woodenhaptics\"", "", "'name'", ""},
      {"[weight]", "[wait]", "wait", ""},
      {"[limits]", "[limits", "", "TOML"},
  };
  const std::string good = wood_text();
  ASSERT_TRUE(parse_arm_description(good, "w.toml"));
  for (const WrongDescription& wrong : wrongs) {
    std::string text = good;
    const std::size_t at = text.find(wrong.from);
    ASSERT_NE(at, std::string::npos) << wrong.from;
    text.replace(at, std::string(wrong.from).size(), wrong.to);
    const auto read = parse_arm_description(text, "w.toml");
    ASSERT_FALSE(read) << wrong.to;
    const Error& error = read.error();
    EXPECT_EQ(error.file, "w.toml") << wrong.to;
    EXPECT_GT(error.line, 0) << wrong.to;
    EXPECT_TRUE(says(error.message(), wrong.what)) << wrong.to << ": " << error.message();
    EXPECT_TRUE(says(error.message(), wrong.remedy)) << wrong.to << ": " << error.message();
  }
}

TEST(ArmDescription, ALinkageThatCannotRestSoIsRefused) {
  std::string text;
  for (const KnownArm& known : built_in_arms())
    if (known.name == "polhem-v3") text = known.text;
  const std::string from = "counts = [8312, -10366, 19764]";
  ASSERT_TRUE(says(text, from));
  text.replace(text.find(from), from.size(), "counts = [8312, 10366, -19764]");
  EXPECT_TRUE(refused(parse_arm_description(text, "p.toml"), "rest pose"));
}

class ArmsOfTheUser : public InFolder {};

TEST_F(ArmsOfTheUser, StandForThoseBuiltIn) {
  std::filesystem::create_directories(folder_ / "palpate/devices");
  std::string text = wood_text();
  text.replace(text.find("force_n = 2.5"), 13, "force_n = 3");
  for (const char* name : {"woodenhaptics", "mine"})
    write_text(in(std::string("palpate/devices/") + name + ".toml"), text);
  const Environment home("XDG_CONFIG_HOME", folder_.c_str());
  EXPECT_EQ(find_arm("woodenhaptics")->limits.force_max_n, 3.0);
  EXPECT_TRUE(find_arm("mine"));
  const auto none = find_arm("polhem-v4");
  ASSERT_FALSE(none);
  EXPECT_TRUE(says(none.error().remedy, "did you mean")) << none.error().message();
}

TEST(OpenDevicesFuzz, TheCorpusAndManyOthersPass) {
  expect_corpus_passes(&LLVMFuzzerTestOneInput, PALPATE_SOURCE_ROOT "/tests/corpus/open_devices", 6);
  Random random(41);
  const std::string kinds = "abcspd";
  const std::string line = "[1,10,20,30,0,0,0,0]\n";
  for (int run = 0; run < 3000; ++run) {
    TestBytes bytes = {static_cast<std::uint8_t>(kinds[random.below(kinds.size())])};
    const std::size_t size = random.below(400);
    while (bytes.size() < size) {
      if (random.below(8) == 0) bytes.insert(bytes.end(), line.begin(), line.end());
      // The plane's address and small reports' numbers come often.
      bytes.push_back(static_cast<std::uint8_t>(random.below(3) == 0 ? random.below(8) : random.below(256)));
    }
    ASSERT_EQ(LLVMFuzzerTestOneInput(bytes.data(), bytes.size()), 0) << "seed 41, run " << run;
  }
}

// ---- Chains and five-bar linkages: by the published formulas, by their own constraints, by finite
// differences.

constexpr double kDeg = std::numbers::pi / 180.0;

ArmGeometry wood() {
  return {ArmLinkage::kChain, {80, 205, 245, 0, 0, 0}, Vec3(220, 0, 80)};
}
ArmGeometry third_polhem() {
  return {ArmLinkage::kFiveBar, {34, 165, 25, 190, 34, 130.8}, Vec3(204.5, 0, 32.5)};
}
ArmAngles any_angles(Random& random) {
  return {random.uniform(-3, 3), random.uniform(-3, 3), random.uniform(-3, 3)};
}

TEST(ArmKinematics, TheRestPoseOfWoodIsAsMeasuredWithARuler) {
  // Upper arm upright, forearm level: 245 in front of the axis, 80 + 205 above the table.
  const auto pose = arm_pose(wood(), {0, 0, 90 * kDeg}).value();
  EXPECT_NEAR((pose.position_mm - Vec3(25, 0, 205)).norm(), 0.0, 1e-12);
  // Both level, turned left by a right angle.
  EXPECT_NEAR((arm_pose(wood(), {90 * kDeg, 90 * kDeg, 90 * kDeg})->position_mm - Vec3(-220, 450, 0)).norm(),
              0.0, 1e-12);
}

TEST(ArmKinematics, AChainShowsForcesAsItsMakersPublished) {
  Random random(31);
  const ArmGeometry arm = wood();
  for (int i = 0; i < 2000; ++i) {
    const ArmAngles q = any_angles(random);
    const Vec3 f = Vec3{random.normal(), random.normal(), random.normal()};
    const double upper = 205, fore = 245, rho = upper * std::sin(q[1]) + fore * std::sin(q[2]);
    const double radial = f.x() * std::cos(q[0]) + f.y() * std::sin(q[0]);
    const Vec3 published(rho * (f.y() * std::cos(q[0]) - f.x() * std::sin(q[0])),
                         upper * (radial * std::cos(q[1]) - f.z() * std::sin(q[1])),
                         fore * (radial * std::cos(q[2]) + f.z() * std::sin(q[2])));
    ASSERT_NEAR((torques_n_mm(*arm_pose(arm, q), f) - published).norm(), 0.0, 1e-10) << "seed 31, " << i;
  }
}

TEST(ArmKinematics, AFiveBarKeepsItsRodsLength) {
  Random random(32);
  const ArmGeometry arm = third_polhem();
  int found = 0;
  for (int i = 0; i < 20000; ++i) {
    const ArmAngles q = any_angles(random);
    const auto pose = arm_pose(arm, q);
    if (!pose) continue;
    ++found;
    // Back from the grip: the plane, the elbow, the forearm's direction, the rod's end behind the elbow.
    const Vec3 base = pose->position_mm + arm.origin_mm;
    const double rho = base.x() * std::cos(q[0]) + base.y() * std::sin(q[0]);
    const Eigen::Vector2d grip(rho, base.z());
    const Eigen::Vector2d elbow(17 + 165 * std::cos(q[1]), 165 * std::sin(q[1]));
    const Eigen::Vector2d crank(-17 + 25 * std::cos(q[2]), 25 * std::sin(q[2]));
    ASSERT_NEAR((grip - elbow).norm(), 130.8, 1e-9);
    const Eigen::Vector2d behind = elbow - (grip - elbow) * (34 / 130.8);
    ASSERT_NEAR((behind - crank).norm(), 190.0, 1e-9) << "seed 32, " << i;
    ASSERT_NEAR(-base.x() * std::sin(q[0]) + base.y() * std::cos(q[0]), 0.0, 1e-9);
  }
  EXPECT_GT(found, 1000);
}

TEST(ArmKinematics, JacobiansAgreeWithFiniteDifferences) {
  Random random(33);
  for (const ArmGeometry& arm : {wood(), third_polhem()}) {
    int checked = 0;
    double worst = 0.0;
    for (int i = 0; i < 20000; ++i) {
      const ArmAngles q = any_angles(random);
      const auto pose = arm_pose(arm, q);
      // Near where the rod is in line the differences are no longer small.
      if (!pose || pose->mm_per_rad.cwiseAbs().maxCoeff() > 500) continue;
      const double h = 1e-5;
      bool whole = true;
      Mat3 differences;
      for (int k = 0; k < 3 && whole; ++k) {
        ArmAngles more = q, less = q;
        more[static_cast<std::size_t>(k)] += h;
        less[static_cast<std::size_t>(k)] -= h;
        const auto above = arm_pose(arm, more), below = arm_pose(arm, less);
        whole = above && below;
        if (whole) differences.col(k) = (above->position_mm - below->position_mm) / (2 * h);
      }
      if (!whole) continue;
      ++checked;
      worst = std::max(worst, (differences - pose->mm_per_rad).cwiseAbs().maxCoeff());
    }
    EXPECT_GT(checked, 1000);
    // h^2 / 6 times a third derivative, which in a linkage grows as the square of the Jacobian.
    EXPECT_LT(worst, arm.linkage == ArmLinkage::kChain ? 1e-6 : 1e-3) << "seed 33";
    std::printf("%s: differs from finite differences by %.1e mm/rad at most, of %d poses\n",
                arm.linkage == ArmLinkage::kChain ? "chain" : "five-bar", worst, checked);
  }
}

TEST(ArmKinematics, LinkagesThatCannotBeAreRefused) {
  const ArmGeometry arm = third_polhem();
  // Both cranks level to the right: the rod would have to be 190 and is 216 at most.
  EXPECT_FALSE(arm_pose(arm, {0, 0, 0}));
  // The other form: the mirror of a good pose.
  const double b = 2.178, c = 4.162;
  ASSERT_TRUE(arm_pose(arm, {0, b, c}));
  EXPECT_FALSE(arm_pose(arm, {0, -b, -c}));
  const double nan = std::nan("");
  EXPECT_FALSE(arm_pose(arm, {0, nan, c}));
  EXPECT_FALSE(arm_pose(wood(), {nan, 0, 0}));
  EXPECT_FALSE(arm_pose(wood(), {0, std::numeric_limits<double>::infinity(), 0}));
}

TEST(ArmKinematics, TheWeightIsHeldByTheGradientOfItsHeight) {
  Random random(34);
  const ArmGeometry arm = wood();
  const ArmMasses masses{0.170, 51, 0.110, 91};
  const auto energy = [&](const ArmAngles& q) {  // N*mm
    const double upper = 80 + 51 * std::cos(q[1]), fore = 80 + 205 * std::cos(q[1]) - 91 * std::cos(q[2]);
    return 9.81 * (0.170 * upper + 0.110 * fore);
  };
  for (int i = 0; i < 500; ++i) {
    const ArmAngles q = any_angles(random);
    const Vec3 torques = weight_torques_n_mm(arm, masses, q);
    for (std::size_t k = 0; k < 3; ++k) {
      ArmAngles more = q, less = q;
      more[k] += 1e-4;
      less[k] -= 1e-4;
      ASSERT_NEAR(torques[static_cast<int>(k)], (energy(more) - energy(less)) / 2e-4, 1e-5)
          << "seed 34, " << i;
    }
  }
  EXPECT_EQ(weight_torques_n_mm(third_polhem(), masses, {0, 2, 4}), Vec3(0, 0, 0));
}

/// Angles for a place, from ones near it; nothing where Newton does not get there.
std::optional<ArmAngles> angles_of(const ArmGeometry& arm, const Vec3& place_mm, ArmAngles q) {
  for (int i = 0; i < 60; ++i) {
    const auto pose = arm_pose(arm, q);
    if (!pose) return std::nullopt;
    const Vec3 left = place_mm - pose->position_mm;
    if (left.norm() < 1e-8) return q;
    const Vec3 step = pose->mm_per_rad.inverse() * left;
    const double share = std::min(1.0, 0.05 / step.norm());
    for (int k = 0; k < 3; ++k) q[static_cast<std::size_t>(k)] += share * step[k];
  }
  return std::nullopt;
}

// Poses with the grip at the origin, found by hand.
ArmAngles at_origin(const ArmDescription& arm) {
  if (arm.geometry.linkage == ArmLinkage::kFiveBar) return {0.0, 52 * kDeg, 135 * kDeg};
  return {0.0, 20 * kDeg, 60 * kDeg};
}

TEST(ArmKinematics, KnownArmsReachTheirWholeWorkspace) {
  Random random(35);
  for (const KnownArm& known : built_in_arms()) {
    const ArmDescription arm = find_arm(known.name).value();
    auto q = angles_of(arm.geometry, Vec3::Zero(), at_origin(arm));
    ASSERT_TRUE(q) << known.name << " cannot be at its origin";
    const Vec3 half = arm.limits.workspace_mm.high_mm;
    double least = 1e300;
    for (int i = 0; i < 400; ++i) {
      Vec3 way = Vec3{random.normal(), random.normal(), random.normal()};
      way *= std::cbrt(random.uniform()) / way.norm();
      const Vec3 place = way.cwiseProduct(half);
      ArmAngles now = *q;
      for (int step = 1; step <= 10; ++step) {
        const auto next = angles_of(arm.geometry, place * (step / 10.0), now);
        ASSERT_TRUE(next) << known.name << " does not reach " << place.transpose() << ", seed 35";
        now = *next;
      }
      // The weakest force that the cap of current leaves, in any direction.
      Mat3 ma_per_n = arm_pose(arm.geometry, now)->mm_per_rad.transpose();
      for (int k = 0; k < 3; ++k) ma_per_n.row(k) *= arm.ma_per_n_mm(static_cast<std::size_t>(k));
      least = std::min(least, 1e3 * arm.current_cap_a / ma_per_n.rowwise().norm().maxCoeff());
    }
    RecordProperty(known.name + "_weakest_n", std::to_string(least));
    std::printf("%s: %.2f N in every direction in its workspace\n", known.name.c_str(), least);
    EXPECT_GE(least, arm.limits.force_max_n) << known.name << ": what it declares, it must be able to show";
  }
}

}  // namespace
}  // namespace palpate::device
