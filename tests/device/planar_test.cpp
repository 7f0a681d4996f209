// Haply's 2DIY: kinematics, bytes, and zero torque on every path, since its board holds the last one.
#include "device/haply/planar_device.h"

#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <optional>

#include "tests/device/helpers.h"
#include "tests/device/hid_fake_link.h"
#include "tests/device/planar_board.h"
#include "toolkit/core/random.h"

namespace palpate::device {
namespace {

constexpr double kPlaneDegrees = 180.0 / std::numbers::pi;

float plane_float(const TestBytes& bytes, std::size_t at) {
  float value = 0.0F;
  std::memcpy(&value, bytes.data() + at, sizeof(value));
  return value;
}

TestBytes reply_of(float first, float second, std::uint8_t address = 5) {
  TestBytes bytes(9);
  bytes[0] = address;
  std::memcpy(bytes.data() + 1, &second, 4);
  std::memcpy(bytes.data() + 5, &first, 4);
  return bytes;
}

/// Angle at the motor between the line to the place and the crank; nothing if out of reach.
std::optional<double> crank_turn(const PantographGeometry& geometry, double distance_mm) noexcept {
  const double l = geometry.crank_mm, bar = geometry.bar_mm;
  const double cosine = (l * l + distance_mm * distance_mm - bar * bar) / (2.0 * l * distance_mm);
  if (!(std::abs(cosine) <= 1.0)) return std::nullopt;
  return std::acos(cosine);
}

/// Angles of a place; nothing if out of reach.
std::optional<std::array<double, 2>> pantograph_angles(const PantographGeometry& geometry,
                                                       const Eigen::Vector2d& place_mm) noexcept {
  const Eigen::Vector2d from_second = place_mm - Eigen::Vector2d(geometry.between_mm, 0.0);
  const std::optional<double> first = crank_turn(geometry, place_mm.norm());
  const std::optional<double> second = crank_turn(geometry, from_second.norm());
  if (!first || !second) return std::nullopt;
  return std::array<double, 2>{std::atan2(place_mm.y(), place_mm.x()) + *first,
                               std::atan2(from_second.y(), from_second.x()) - *second};
}

TEST(Pantograph, ThereAndBackOverTheWorkspaceWithItsJacobian) {
  Random random(37);
  for (const int generation : {2, 3}) {
    const PlanarModel& model = *planar_model(generation);
    const PantographGeometry& geometry = model.geometry;
    const FakeWire none;
    const VirtualClock clock;
    FakeWire wire;
    const PlanarDevice device(std::make_unique<FakeLink>(wire), clock, model);
    const Vec3 half = device.limits().workspace_mm.high_mm;
    double worst = 0.0, weakest = 1e300;
    for (int i = 0; i < 4000; ++i) {
      const Eigen::Vector2d place = device.origin_mm() + Eigen::Vector2d(random.uniform(-1, 1) * half.x(),
                                                                         random.uniform(-1, 1) * half.y());
      const auto angles = pantograph_angles(geometry, place);
      ASSERT_TRUE(angles) << generation << ": " << place.transpose();
      const auto pose = pantograph_pose(geometry, *angles);
      ASSERT_TRUE(pose) << generation << ": " << place.transpose() << ", seed 37";
      ASSERT_NEAR((pose->position_mm - place).norm(), 0.0, 1e-9) << place.transpose();
      Eigen::Matrix2d differences;
      for (int k = 0; k < 2; ++k) {
        auto more = *angles, less = *angles;
        more[static_cast<std::size_t>(k)] += 1e-5;
        less[static_cast<std::size_t>(k)] -= 1e-5;
        differences.col(k) =
            (pantograph_pose(geometry, more)->position_mm - pantograph_pose(geometry, less)->position_mm) /
            2e-5;
      }
      worst = std::max(worst, (differences - pose->mm_per_rad).cwiseAbs().maxCoeff());
      weakest = std::min(weakest, 123.0 / pose->mm_per_rad.colwise().norm().maxCoeff());
    }
    EXPECT_LT(worst, 1e-5);
    std::printf("2DIY, generation %d: %.2f N in every direction in its workspace, Jacobian to %.1e mm/rad\n",
                generation, weakest, worst);
    EXPECT_GE(weakest, PlanarOptions{}.force_max_n) << "what it declares, it must be able to show";
  }
}

TEST(Pantograph, BarsThatDoNotReachOrLieInLineAreRefused) {
  const PantographGeometry geometry;
  EXPECT_FALSE(pantograph_pose(geometry, {0.0, 0.0})) << "both cranks in one place";
  const PantographGeometry wide{70.0, 90.0, 100.0};
  EXPECT_FALSE(pantograph_pose(wide, {std::numbers::pi, 0.0})) << "240 apart, and the bars make 180";
  EXPECT_FALSE(pantograph_pose(geometry, {std::nan(""), 0.0}));
  EXPECT_FALSE(pantograph_angles(geometry, {200.0, 0.0}));
  EXPECT_FALSE(pantograph_angles(geometry, {0.0, 5.0}));
  // Both of generation 2 rest where they are set up.
  const auto rest = pantograph_pose(geometry, {241 / kPlaneDegrees, -61 / kPlaneDegrees}).value();
  EXPECT_NEAR(rest.position_mm.x(), 0.0, 1e-9);
  EXPECT_NEAR(rest.position_mm.y(),
              std::sqrt(90 * 90 - 33.9367 * 33.9367) - 70 * std::sin(61 / kPlaneDegrees), 1e-3);
}

TEST(PlanarProtocol, MessagesHaveTheseBytes) {
  const CommandBytes second = encoded_set_up(*planar_model(2));
  const TestBytes bytes(second.span().begin(), second.span().end());
  ASSERT_EQ(bytes.size(), 26u);
  EXPECT_EQ(TestBytes(bytes.begin(), bytes.begin() + 10), (TestBytes{1, 5, 3, 0, 1, 3, 0, 1, 0, 0}));
  EXPECT_EQ(plane_float(bytes, 10), -61.0F);
  EXPECT_EQ(plane_float(bytes, 14), 10752.0F);
  EXPECT_EQ(plane_float(bytes, 18), 241.0F);
  EXPECT_EQ(plane_float(bytes, 22), 10752.0F);
  const CommandBytes torques = encoded_torques({0.5F, -0.25F});
  const TestBytes command(torques.span().begin(), torques.span().end());
  ASSERT_EQ(command.size(), 10u);
  EXPECT_EQ(command[0], 2);
  EXPECT_EQ(command[1], 5);
  EXPECT_EQ(plane_float(command, 2), -0.25F) << "motor 2 is on port 1";
  EXPECT_EQ(plane_float(command, 6), 0.5F);
  EXPECT_EQ(planar_model(1), nullptr);
}

// A program that is killed may leave any part of a command: zero must be whole for the board all the same.
TEST(PlanarProtocol, NoPartOfACommandBeforeSpoilsLettingGo) {
  const CommandBytes release = encoded_release();
  constexpr float kHeldNm = 0.1F, kCutNm = 0.123F;
  const CommandBytes held = encoded_torques({kHeldNm, -kHeldNm});
  for (const CommandBytes& cut : {encoded_torques({kCutNm, -kCutNm}), encoded_set_up(*planar_model(3))})
    for (const UnknownByte unknown : {UnknownByte::kPassedOver, UnknownByte::kWithItsAddress})
      for (std::size_t sent = 0; sent < cut.size; ++sent) {
        PlanarBoard board(unknown);
        board.take(held.span());
        ASSERT_EQ(board.torques, (std::array<float, 2>{-kHeldNm, kHeldNm}));
        board.take(cut.span().first(sent));
        const int obeyed = board.obeyed;
        board.take(release.span());
        EXPECT_EQ(board.torques, (std::array<float, 2>{})) << sent << " of " << cut.size;
        EXPECT_GT(board.obeyed, obeyed);
        EXPECT_LE(board.most, kCutNm) << "what it made of the part";
      }
}

/// A board at the other end of a line. It can sleep once: for so many polls after a command it takes nothing,
/// and then all that has come as one.
class BoardLink final : public Link {
 public:
  BoardLink(PlanarBoard& board, int sleeps) : board_(board), sleeps_(sleeps) {}
  Status open() override { return Done{}; }
  void close() noexcept override {}
  bool submit(std::span<const std::uint8_t> bytes) noexcept override {
    waiting_.insert(waiting_.end(), bytes.begin(), bytes.end());
    return true;
  }
  Polled poll(std::span<std::uint8_t> into) noexcept override {
    if (--sleeps_ < 0) {
      const PlanarBoard::Bytes answers = board_.take(std::exchange(waiting_, {}));
      replies_.insert(replies_.end(), answers.begin(), answers.end());
    }
    const std::size_t size = std::min(into.size(), replies_.size());
    const auto end = replies_.begin() + static_cast<std::ptrdiff_t>(size);
    std::copy(replies_.begin(), end, into.begin());
    replies_.erase(replies_.begin(), end);
    return {size, false};
  }

 private:
  PlanarBoard& board_;
  int sleeps_;
  PlanarBoard::Bytes waiting_, replies_;
};

TEST(PlanarProtocol, NoPartOfACommandIsHeldByABoardThatHasLetGo) {
  const CommandBytes held = encoded_torques({0.1F, -0.1F});
  int late = 0;
  for (const CommandBytes& cut : {encoded_torques({0.123F, -0.123F}), encoded_set_up(*planar_model(2))})
    for (const UnknownByte unknown :
         {UnknownByte::kPassedOver, UnknownByte::kWithItsAddress, UnknownByte::kWithAllThatCame})
      for (std::size_t sent = 0; sent < cut.size; sent += 1 + sent / 10)
        for (const int sleeps : {0, 8}) {  // longer than a quiet line is waited for
          PlanarBoard board(unknown);
          board.take(held.span());
          board.take(cut.span().first(sent));
          BoardLink link(board, sleeps);
          ASSERT_TRUE(release_plane(link)) << sent << " of " << cut.size;
          ASSERT_EQ(board.torques, (std::array<float, 2>{}))
              << sent << " of " << cut.size << ", asleep for " << sleeps;
          ASSERT_LE(board.most, 0.123F);
          late += sleeps > 0 ? 1 : 0;
        }
  EXPECT_GT(late, 50);
}

TEST(PlanarProtocol, RepliesAreFoundAndNonsenseIsNot) {
  PlanarReader reader;
  const auto feed = [&](const TestBytes& bytes) {
    std::optional<std::array<float, 2>> last;
    for (const std::uint8_t byte : bytes)
      if (const auto found = reader.take(byte)) last = found;
    return last;
  };
  EXPECT_EQ(feed(reply_of(241.0F, -61.0F)), (std::array<float, 2>{241.0F, -61.0F}));
  EXPECT_FALSE(feed(reply_of(241.0F, -61.0F, 4))) << "another address";
  EXPECT_EQ(reader.malformed_in_a_row(), 0u);
  for (const float impossible : {std::nanf(""), std::numeric_limits<float>::infinity(), 1e30F, -721.0F}) {
    reader.begin();
    EXPECT_FALSE(feed(reply_of(impossible, 0.0F)));
    reader.begin();
    EXPECT_FALSE(feed(reply_of(0.0F, impossible)));
  }
  EXPECT_GE(reader.malformed_in_a_row(), 8u);
  reader.begin();
  EXPECT_TRUE(feed(reply_of(1.0F, 2.0F)));
  // Torn: what has come of one reply is not the beginning of the next command's.
  EXPECT_FALSE(feed(TestBytes{5, 1, 2, 3}));
  reader.begin();
  EXPECT_EQ(reader.malformed_in_a_row(), 1u);
  EXPECT_EQ(feed(reply_of(3.0F, 4.0F)), (std::array<float, 2>{3.0F, 4.0F}));
}

struct PlaneRig {
  explicit PlaneRig(int open_tries = 0) {
    clock.advance(1.0);
    wire.keeps_rest = true;
    PlanarOptions options{.open_tries = open_tries};
    device =
        std::make_unique<PlanarDevice>(std::make_unique<FakeLink>(wire), clock, *planar_model(2), options);
  }
  DeviceState at(double x_mm, double y_mm) {
    const auto angles =
        pantograph_angles(planar_model(2)->geometry, device->origin_mm() + Eigen::Vector2d(x_mm, y_mm));
    wire.give(reply_of(static_cast<float>((*angles)[0] * kPlaneDegrees),
                       static_cast<float>((*angles)[1] * kPlaneDegrees)));
    clock.advance(1e-3);
    return device->read();
  }
  DeviceState frame() {
    clock.advance(1e-3);
    return device->read();
  }
  [[nodiscard]] Eigen::Vector2d last_n_mm() const {
    return 1e3 * Eigen::Vector2d(static_cast<double>(plane_float(wire.sent.back(), 6)),
                                 static_cast<double>(plane_float(wire.sent.back(), 2)));
  }
  VirtualClock clock;
  FakeWire wire;
  std::unique_ptr<PlanarDevice> device;
};
const TestBytes kPlaneZero = {2, 5, 0, 0, 0, 0, 0, 0, 0, 0};

TEST(PlanarDevice, IsSetUpWithZeroBeforeAndAfter) {
  PlaneRig rig;
  ASSERT_TRUE(rig.device->open());
  ASSERT_EQ(rig.wire.sent.size(), 4u);
  EXPECT_EQ(rig.wire.sent[0], kPlaneZero);
  EXPECT_EQ(rig.wire.sent[1], kPlaneZero) << "the first may be the rest of what was cut off";
  EXPECT_EQ(rig.wire.sent[2].front(), 1);
  EXPECT_EQ(rig.wire.sent[3], kPlaneZero);
  EXPECT_FALSE(rig.frame().homed);
  const DeviceState state = rig.at(10, -20);
  EXPECT_TRUE(state.homed);
  EXPECT_EQ(state.status, ReadStatus::kFresh);
  EXPECT_NEAR((state.position_mm - Vec3(10, -20, 0)).norm(), 0.0, 1e-4) << "float degrees";
  EXPECT_EQ(state.raw.size, 9);
}

TEST(PlanarDevice, ForcesBecomeTorquesAndZIsNotShown) {
  PlaneRig rig;
  ASSERT_TRUE(rig.device->open());
  rig.at(10, -20);
  const auto angles =
      pantograph_angles(planar_model(2)->geometry, rig.device->origin_mm() + Eigen::Vector2d(10, -20));
  const auto pose = pantograph_pose(planar_model(2)->geometry, *angles);
  rig.device->send(governed(Vec3(0.5, -0.25, 3.0)));
  EXPECT_NEAR((rig.last_n_mm() - pose->mm_per_rad.transpose() * Eigen::Vector2d(0.5, -0.25)).norm(), 0.0,
              1e-3);
  rig.at(10, -20);
  rig.device->send(governed(Vec3(0, 0, 3.0)));
  EXPECT_EQ(rig.wire.sent.back(), kPlaneZero);
  // Beyond the cap both are scaled: the direction stays.
  rig.at(10, -20);
  rig.device->send(governed(Vec3(50, -25, 0)));
  const Eigen::Vector2d capped = rig.last_n_mm(),
                        wanted = pose->mm_per_rad.transpose() * Eigen::Vector2d(50, -25);
  EXPECT_NEAR(capped.cwiseAbs().maxCoeff(), 123.0, 1e-3);
  EXPECT_NEAR(capped.x() * wanted.y() - capped.y() * wanted.x(), 0.0, 1e-4 * wanted.squaredNorm());
}

TEST(PlanarDevice, ZeroGoesOutOnEveryPath) {
  const std::pair<const char*, void (*)(PlaneRig&)> ends[] = {
      {"of the force, though the board has not answered yet",
       [](PlaneRig& rig) { rig.device->send(governed(Vec3::Zero())); }},
      {"closed", [](PlaneRig& rig) { rig.device->close(); }},
      {"destroyed", [](PlaneRig& rig) { rig.device.reset(); }},
      {"cut", [](PlaneRig& rig) { EXPECT_TRUE(rig.device->cut_force()); }},
      {"opened again", [](PlaneRig& rig) { EXPECT_TRUE(rig.device->open().ok()); }},
      {"both cranks in one place",
       [](PlaneRig& rig) {
         rig.wire.give(reply_of(0.0F, 0.0F));
         EXPECT_EQ(rig.frame().status, ReadStatus::kGarbled);
         rig.device->send(governed(Vec3(0.5, 0.5, 0)));
       }},
      {"silent: nobody knows where the grip is by now", [](PlaneRig& rig) {
         rig.clock.advance(0.021);
         rig.device->send(governed(Vec3(0.5, 0.5, 0)));
       }}};
  for (const auto& [name, end] : ends) {
    SCOPED_TRACE(name);
    PlaneRig rig;
    ASSERT_TRUE(ok(rig.device->open()));
    rig.at(0, 0);
    rig.device->send(governed(Vec3(0.5, 0.5, 0)));
    ASSERT_NE(rig.wire.sent.back(), kPlaneZero);
    end(rig);
    EXPECT_EQ(rig.wire.sent.back(), kPlaneZero);
  }
}

TEST(PlanarDevice, KeepsTheBeatAndSaysWhatIsWrong) {
  PlaneRig rig;
  ASSERT_TRUE(rig.device->open());
  rig.at(0, 0);
  rig.device->send(governed(Vec3(0.5, 0, 0)));
  const std::size_t sent = rig.wire.sent.size();
  rig.device->send(governed(Vec3(0.6, 0, 0)));
  EXPECT_EQ(rig.wire.sent.size(), sent) << "one command for each reply";
  EXPECT_EQ(rig.frame().status, ReadStatus::kNothingNew);
  const Vec3 before = rig.at(0, 0).position_mm;
  for (int i = 0; i < 3; ++i) {
    rig.wire.give(TestBytes{5, 0, 0, 0});
    rig.frame();
    rig.clock.advance(0.021);
    rig.device->send(governed(Vec3::Zero()));
  }
  const DeviceState garbled = rig.frame();
  EXPECT_EQ(garbled.status, ReadStatus::kGarbled);
  EXPECT_EQ(garbled.position_mm, before);
  EXPECT_EQ(rig.at(0, 0).status, ReadStatus::kFresh);
  rig.wire.gone = true;
  EXPECT_EQ(rig.frame().status, ReadStatus::kLost);
}

TEST(PlanarDevice, ASilentBoardIsNotOpened) {
  PlaneRig rig(2);
  EXPECT_TRUE(refused(rig.device->open(), "does not answer"));
  EXPECT_EQ(rig.wire.sent.back(), kPlaneZero);
  EXPECT_FALSE(rig.wire.open);
}

TEST(PlanarDriver, WantsItsLineNamed) {
  const Driver driver = driver_of(&register_planar_driver, "planar");
  EXPECT_EQ(driver.look().size(), 1u);
  const MonotonicClock clock;
  const auto refused = [&](const DeviceRequest& request) { return refusal_of(driver, request); };
  EXPECT_TRUE(says(refused({"planar", {}, {}}), "must be named"));
  EXPECT_TRUE(says(refused({"planar", {}, {{"path", "/dev/none"}, {"generation", "1"}}}), "give 2 or 3"));
  EXPECT_TRUE(says(refused({"planar", {}, {{"path", "/dev/none"}, {"force_n", "9"}}}), "force_n"));
  EXPECT_TRUE(says(refused({"planar", {}, {{"pat", "/dev/none"}}}), "did you mean 'path'"));
  const auto made = driver.make({"planar", {}, {{"path", "/dev/none"}}}, clock);
  ASSERT_TRUE(made);
  EXPECT_FALSE(made->zero());
  EXPECT_FALSE(made->device->open());
  EXPECT_EQ(made->unproven.size(), 3u);
}

}  // namespace
}  // namespace palpate::device
