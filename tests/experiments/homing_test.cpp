// What a person at a device is told until it knows its zero: Falcon and arms, pretended, in `palpate live`,
// `palpate live record` and `palpate list devices --report`. And the force of a device that has no motors, on
// a terminal.
#include <sys/ioctl.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "device/arms/arm_device.h"
#include "device/falcon/falcon_device.h"
#include "experiments/live/doctor.h"
#include "experiments/live/live.h"
#include "experiments/live/recording_session.h"
#include "tests/device/hid_fake_link.h"
#include "tests/device/tty_board.h"
#include "tests/experiments/live_device_rig.h"
#include "tests/experiments/program.h"
#include "tests/experiments/pulled_falcon.h"

namespace palpate::experiments {
namespace {

/// An arm that is moved for so many reports, and then lies in its rest pose with its button pressed.
class LaidArm final : public device::Link {
 public:
  LaidArm(device::ArmForm form, int moved) : form_(form), moved_(moved) {}
  Status open() override { return Done{}; }
  void close() noexcept override {}
  bool submit(std::span<const std::uint8_t> bytes) noexcept override {
    const device::TestBytes command(bytes.begin(), bytes.end());
    if (form_ == device::ArmForm::kReport14 && device::word_of(command, 3) == 1)
      for (std::size_t i = 0; i < 3; ++i) counts_[i] = device::word_of(command, 4 + i);
    ready_ = true;
    return true;
  }
  device::Polled poll(std::span<std::uint8_t> into) noexcept override {
    if (!std::exchange(ready_, false)) return {};
    ++reports_;
    const bool laid = reports_ > moved_;
    if (!laid) counts_[0] = 3 * reports_ % 1000;
    const device::TestBytes bytes =
        form_ == device::ArmForm::kReport8
            ? device::words({counts_[0], counts_[1], counts_[2], reports_ % 30'000})
            : device::words({counts_[0], counts_[1], counts_[2], 0, 0, 0, laid ? 1 : 0});
    std::copy(bytes.begin(), bytes.end(), into.begin());
    return {bytes.size(), false};
  }

 private:
  device::ArmForm form_;
  int moved_, reports_ = 0;
  std::array<int, 3> counts_{};
  bool ready_ = false;
};

/// Drivers "falcon", "lying" and "button" that simulate; homing takes so many ticks a step.
device::Drivers homing_drivers(int ticks) {
  device::Drivers drivers;
  const auto look = [] {
    return std::vector<device::DeviceEntry>{{"pretended", "for tests", device::DeviceStatus::kReady, {}}};
  };
  drivers.add({"falcon", "simulation", look,
               [ticks](const device::DeviceRequest&, const Clock& clock) -> Result<device::MadeDevice> {
                 return pulled_falcon(clock, ticks);
               }});
  for (const auto& [name, arm] : {std::pair{"lying", "woodenhaptics"}, std::pair{"button", "polhem-v2"}})
    drivers.add({name, "simulation", look,
                 [ticks, arm = std::string(arm)](const device::DeviceRequest&,
                                                 const Clock& clock) -> Result<device::MadeDevice> {
                   const device::ArmDescription described = device::find_arm(arm).value();
                   device::MadeDevice made;
                   made.device = std::make_unique<device::ArmDevice>(
                       described, std::make_unique<LaidArm>(described.form, ticks), clock,
                       device::ArmDeviceOptions{.open_tries = 0});
                   made.homing_prompt = device::arm_homing_prompt;
                   return made;
                 }});
  return drivers;
}

/// Whether the text has all of these, one after the other.
testing::AssertionResult has_in_order(const std::string& text, const std::vector<std::string>& words) {
  std::size_t at = 0;
  for (const std::string& one : words) {
    at = text.find(one, at);
    if (at == std::string::npos)
      return testing::AssertionFailure() << "no '" << one << "' there in\n" << text;
    at += one.size();
  }
  return testing::AssertionSuccess();
}

class Homing : public InFolder {
 protected:
  LiveArguments session(const std::string& device, double seconds) const {
    LiveArguments a = session_of(device, in("out"), seconds);
    a.accelerated = true;
    return a;
  }
  /// What `palpate live` says on standard error.
  std::string live_says(const std::string& device, double seconds) {
    ProgressBar progress;
    Context context{progress, "palpate live"};
    const ProcessOutcome run =
        captured([&] { return run_live_with(session(device, seconds), homing_drivers(1500), context); });
    EXPECT_EQ(run.exit_code, kExitOk) << run.err;
    return run.err;
  }
};

TEST_F(Homing, LiveTellsHowAFalconIsHomedLegByLeg) {
  EXPECT_TRUE(has_in_order(
      live_says("falcon", 8.0),
      {"does not know its zero yet, and shows no force. Pull the grip all the way out", "(0 of 3 legs",
       "(1 of 3 legs", "(2 of 3 legs", "the device knows its zero; force comes with a soft start"}));
}

TEST_F(Homing, LiveTellsWhatAnArmNeeds) {
  EXPECT_TRUE(has_in_order(live_says("lying", 5.0),
                           {"Lay the arm in its rest pose and let go", "the device knows its zero; force"}));
}

TEST_F(Homing, RecordTellsItToo) {
  RecordArguments a;
  a.scene = kSmallWaves;
  a.renderer = "cloud";
  a.device.device = "button";
  a.seconds = 5.0;
  a.accelerated = true;
  a.out = in("one.palrec");
  a.load.threads = 1;
  ProgressBar progress;
  Context context{progress, "palpate live record"};
  const ProcessOutcome run = captured([&] { return run_record_with(a, homing_drivers(1500), context); });
  EXPECT_EQ(run.exit_code, kExitOk) << run.err;
  EXPECT_TRUE(has_in_order(run.err, {"in its rest pose and press its calibration button", "knows its zero"}));
}

TEST_F(Homing, TheReportTellsItAndKeepsWhatItTold) {
  for (const auto& [device, first] :
       {std::pair{"falcon", "Pull the grip all the way out"}, std::pair{"lying", "Lay the arm"}}) {
    DeviceArguments arguments;
    arguments.device = device;
    testing::internal::CaptureStderr();
    const Result<ReportedDevice> report =
        report_device(arguments, homing_drivers(150), {.seconds = 3.0, .rate_hz = 500.0}, {});
    const std::string said = testing::internal::GetCapturedStderr();
    ASSERT_TRUE(report);
    const auto homing = nlohmann::json::parse(report->json)["homing"];
    EXPECT_FALSE(homing["at_start"].get<bool>());
    ASSERT_TRUE(homing["at_end"].get<bool>()) << report->json;
    ASSERT_GE(homing["told"].size(), 2u) << device;
    EXPECT_NE(homing["told"].front().get<std::string>().find(first), std::string::npos);
    EXPECT_EQ(homing["told"].back(), "the device knows its zero");
    EXPECT_TRUE(has_in_order(said, {first, "the device knows its zero\n"}));
  }
}

TEST(Force, InWordsIsABarAndItsAxes) {
  EXPECT_EQ(force_in_words(Vec3{0.0, 0.0, 1.1}, 3.3), " 1.10 N [====        ] x +0.00 y +0.00 z +1.10");
  EXPECT_EQ(force_in_words(Vec3{0.0, 0.0, 0.0}, 3.3), " 0.00 N [            ] x +0.00 y +0.00 z +0.00");
  EXPECT_EQ(force_in_words(Vec3{-9.0, 0.0, 0.0}, 3.3), " 9.00 N [============] x -9.00 y +0.00 z +0.00");
  EXPECT_EQ(force_in_words(Vec3{0.0, 0.5, 0.0}, 0.0), " 0.50 N [            ] x +0.00 y +0.50 z +0.00");
}

/// Standard error is a terminal of ours while this is there.
class TerminalForErrors {
 public:
  TerminalForErrors() : kept_(::dup(STDERR_FILENO)) {
    const int line = ::open(terminal_.path().c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);
    EXPECT_GE(line, 0);
    winsize size{};
    size.ws_col = 120;
    size.ws_row = 24;
    ::ioctl(line, TIOCSWINSZ, &size);
    std::fflush(stderr);
    ::dup2(line, STDERR_FILENO);
    ::close(line);
  }
  /// What was written; standard error is what it was.
  std::string text() {
    std::fflush(stderr);
    ::dup2(kept_, STDERR_FILENO);
    ::close(kept_);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    const device::TtyBoard::Bytes all = terminal_.received();
    return {all.begin(), all.end()};
  }

 private:
  device::TtyBoard terminal_;
  int kept_;
};

TEST_F(Homing, WithoutMotorsTheForceStandsOnTheTerminal) {
  for (const bool motors : {false, true}) {
    PacketsPlan plan(in("board"));
    plan.has_motors = motors;
    LiveArguments a = session("packets", 1.5);
    a.accelerated = false;
    a.run.out = in(motors ? "with" : "without");
    testing::internal::CaptureStdout();
    TerminalForErrors terminal;
    int status = kExitOk;
    {
      ProgressBar progress;
      Context context{progress, "palpate live"};
      status = run_live_with(a, drivers_with(plan), context);
    }
    const std::string shown = terminal.text();
    testing::internal::GetCapturedStdout();
    EXPECT_LE(status, kExitFellShort) << shown;
    EXPECT_EQ(shown.find(" N [") == std::string::npos, motors) << shown;
    EXPECT_TRUE(motors || shown.find("live  ") != std::string::npos) << shown;
  }
}

}  // namespace
}  // namespace palpate::experiments
