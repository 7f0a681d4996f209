#include "device/falcon/falcon_device.h"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>

#include <palpate/clock.h>
#include <palpate/options.h>
#include <palpate/result.h>
#include "device/interface/driver_options.h"
#include "device/links/usb_link.h"

namespace palpate::device {
namespace {

// Three damaged replies in a row mean a broken connection.
constexpr std::uint32_t kFalconMostBad = 3;
constexpr std::size_t kFalconPollBytes = 64;
constexpr int kCloseTries = 20;  // ms to wait for queue room when closing: it drains within two

// The whole sphere is reachable; the Jacobian's determinant varies 3.5-fold.
constexpr double kReachMm = 40.0;
constexpr double kStepMm = 0.05;       // one count per motor, rms
constexpr double kFalconRateHz = 1e3;  // of full-speed USB
// Stated by the maker and users' libraries; 1 to 1.5 N/mm is reported to stay quiet.
constexpr double kFalconStiffness = 3.0, kFalconDamping = 0.020;

std::uint8_t flags_of(bool homed) noexcept {
  return static_cast<std::uint8_t>(FalconCommand::kHoming |
                                   (homed ? FalconCommand::kGreen : FalconCommand::kRed));
}

const Vec3 kFalconMiddle{0.0, 0.0, kFalconCentreMm};

constexpr const char* kDriverName = "falcon";
constexpr std::uint16_t kFalconVendor = 0x0403, kFalconProduct = 0xCB48;
constexpr UsbInterface kFalconInterface{0, 0x81, 0x02};
constexpr unsigned kZeroWaitMs = 50;
// Absent for longer than this means unplugged: a device released by a dead program returns to the bus at
// once.
constexpr double kAbsentMs = 250.0;
// Knowledge of the motors bounds K within a factor of ten.
constexpr double kMinCounts = 1.0, kMaxCounts = 100.0;

struct FalconRequest {
  FalconOptions options;
  UsbAddress address{kFalconVendor, kFalconProduct, {}};
};

Status read_options(const DeviceRequest& asked, FalconOptions& options) {
  const auto take_firmware = [&options](const std::string& file) -> Status {
    if (file.empty()) return Error{"firmware names no file", "give firmware=FILE"};
    options.firmware = [file] { return find_falcon_firmware(falcon_firmware_places(file)); };
    return Done{};
  };
  return take_options(asked, "the Falcon",
                      {{"firmware", take_firmware},
                       number_option("k", options.counts_per_n_mm, {kMinCounts, kMaxCounts}),
                       switch_option("calibrated", options.calibrated),
                       switch_option("event-character", options.event_character)});
}

Result<FalconRequest> read_request(const DeviceRequest& asked) {
  FalconRequest request;
  if (const auto colon = asked.name.find(':'); colon != std::string::npos) {
    request.address.serial = asked.name.substr(colon + 1);
    if (request.address.serial.empty())
      return Error{"no serial number follows the colon", "give falcon, or falcon:SERIAL", kDriverName};
  }
  if (!asked.description.empty())
    return Error{"the Falcon takes no description file",
                 "leave it out; its options are firmware, k, calibrated and event-character",
                 asked.description.string()};
  if (Status taken = read_options(asked, request.options); !taken)
    return std::move(taken).error().in_file(kDriverName);
  const bool has_k = std::any_of(asked.options.begin(), asked.options.end(),
                                 [](const auto& option) { return option.first == "k"; });
  if (request.options.calibrated && !has_k)
    return Error{"calibrated=yes without the number that was found",
                 "give k=COUNTS too: docs/how-to/connect-a-device.md tells how it is found by weights",
                 kDriverName};
  return request;
}

std::vector<std::string> unproven(const FalconOptions& options) {
  std::vector<std::string> all = {
      "no Falcon has run this driver yet: protocol and geometry are from public sources, shown on a "
      "simulated one",
      "whether its motors let go when packets stop: a guard process and the watchdog command zero",
      "mechanical stops, colours of the lights, order of the homing flags"};
  if (!options.calibrated)
    all.emplace_back(
        "the scale of its forces: they may be three times what is asked, so 2 N is the limit until it is "
        "calibrated by weights (docs/how-to/connect-a-device.md)");
  if (options.event_character) all.emplace_back("the event character, which is untried on a Falcon");
  return all;
}

/// For the guard: each call is one try.
std::function<bool()> zero_of(const UsbAddress& address) {
  return [address, absent = std::shared_ptr<Stopwatch>()]() mutable {
    switch (usb_send_once(address, kFalconInterface, falcon_zero(), kZeroWaitMs)) {
      case UsbSent::kSent:
        return true;
      case UsbSent::kAbsent:
        if (!absent) absent = std::make_shared<Stopwatch>();
        return absent->ms() > kAbsentMs;
      case UsbSent::kRefused:
        break;
    }
    absent.reset();
    return false;
  };
}

std::vector<DeviceEntry> look_for_falcons() {
  constexpr const char* kWhat = "Novint Falcon: 3 force axes, 2 N until calibrated, 8 N then";
  const Result<FalconFirmware> image = find_falcon_firmware(falcon_firmware_places({}));
  std::vector<std::string> firmware;
  if (!image)
    firmware.push_back("firmware, unless a program has loaded it since power-up: " + image.error().message());
  std::vector<DeviceEntry> entries;
  for (const UsbFound& found : usb_devices(kFalconVendor, kFalconProduct)) {
    DeviceEntry entry{kDriverName, kWhat, found.may_open ? DeviceStatus::kReady : DeviceStatus::kRefused,
                      firmware};
    if (!found.may_open) entry.needs.insert(entry.needs.begin(), kUdevRemedy);
    entries.push_back(std::move(entry));
  }
  if (entries.empty()) {
    firmware.insert(firmware.begin(), "a Falcon on USB (0403:cb48), with its power supply");
    entries.push_back({kDriverName, kWhat, DeviceStatus::kMissing, std::move(firmware)});
  }
  return entries;
}

DeviceFacts falcon_facts(const FalconDevice& device, const UsbLink& link, const FalconOptions& options) {
  const FalconBooted& booted = device.booted();
  const FalconCounters counted = device.counters();
  const UsbLinkCounters usb = link.counters();
  DeviceFacts facts = {{"firmware", booted.was_running ? "ran already" : booted.firmware},
                       {"firmware_sha256", booted.sha256},
                       {"firmware_loadings", std::to_string(booted.attempts)},
                       {"counts_per_n_mm", fmt::format("{:g}", options.counts_per_n_mm)},
                       {"calibrated", options.calibrated ? "yes" : "no"},
                       {"event_character", options.event_character ? "yes" : "no"}};
  add_counts(facts, {{"replies", counted.replies},
                     {"replies_malformed", counted.malformed},
                     {"bytes_dropped", counted.dropped},
                     {"replies_unreachable", counted.unreachable},
                     {"commands_refused", counted.refused},
                     {"usb_packets", usb.received},
                     {"usb_packets_overrun", usb.overrun},
                     {"usb_commands", usb.sent},
                     {"usb_commands_overtaken", usb.overtaken},
                     {"usb_in_errors", usb.in_errors},
                     {"usb_out_errors", usb.out_errors}});
  facts.emplace_back("usb_command_mean_us", fmt::format("{:.1f}", usb.out_mean_us));
  facts.emplace_back("usb_command_most_us", fmt::format("{:.1f}", usb.out_most_us));
  return facts;
}

}  // namespace

std::string falcon_homing_prompt(std::uint8_t homed_legs) {
  int legs = 0;
  for (int leg = 0; leg < 3; ++leg) legs += (homed_legs >> leg) & 1;
  if (legs == 3) return {};
  return "Pull the grip all the way out, then push it all the way in (" + std::to_string(legs) +
         " of 3 legs know their zero)";
}

FalconBytes falcon_zero() noexcept {
  return encoded(FalconCommand{{}, flags_of(false)});
}

FalconDevice::FalconDevice(std::unique_ptr<ControlLink> link, const Clock& clock, FalconOptions options)
    : link_(std::move(link)), clock_(clock), options_(std::move(options)), zero_(falcon_zero()) {
  if (!options_.firmware) options_.firmware = [] { return find_falcon_firmware(falcon_firmware_places({})); };
}

// Commands zero force: the firmware probe sends nothing else.
Status FalconDevice::open() {
  close();
  if (!std::isfinite(options_.counts_per_n_mm) || !(options_.counts_per_n_mm > 0.0))
    return Error{"the Falcon's scale from torque to motor counts is not right", "give a number above 0",
                 name()};
  PALPATE_TRY(link_->open());
  Result<FalconBooted> booted =
      boot_falcon(*link_, {options_.firmware, options_.pause, options_.event_character});
  if (!booted) {
    link_->close();
    return std::move(booted).error();
  }
  booted_ = std::move(booted).value();
  reader_.clear();
  counters_ = {};
  state_ = {};
  state_.homed = false;  // until all legs report it
  arm_mm_ = kFalconMiddle;
  homed_legs_ = 0;
  unreachable_in_a_row_ = 0;
  open_ = true;
  return Done{};
}

void FalconDevice::close() noexcept {
  if (!open_) return;
  open_ = false;
  for (int tries = 0; !link_->submit(zero_) && tries < kCloseTries && !link_->poll({}).gone; ++tries)
    options_.pause(1);
  link_->close();
}

DeviceLimits FalconDevice::limits() const noexcept {
  return {options_.calibrated ? kFalconForce : kFalconFirstForce,
          {Vec3::Constant(-kReachMm), Vec3::Constant(kReachMm)},
          kStepMm,
          kFalconRateHz,
          kFalconStiffness,
          kFalconDamping,
          WorkspaceShape::kEllipsoid};
}

DeviceState FalconDevice::read() noexcept {
  state_.status = open_ ? ReadStatus::kNothingNew : ReadStatus::kLost;
  std::array<std::uint8_t, kFalconPollBytes> bytes;
  std::optional<FalconReply> newest;
  std::uint8_t homed_in_all = FalconReply::kAllLegs;  // a flag lost in one reply counts as lost
  for (int i = 0; open_ && i < kMaxPolls; ++i) {
    const Polled polled = link_->poll(bytes);
    for (const std::uint8_t byte : ftdi_payload(std::span(bytes).first(polled.size)))
      if (const std::optional<FalconReply> reply = reader_.take(byte)) {
        newest = reply;
        homed_in_all &= reply->homed;
        ++counters_.replies;
      }
    if (polled.gone) state_.status = ReadStatus::kLost;
    if (polled.size == 0 || polled.gone) break;
  }
  if (state_.status == ReadStatus::kLost) return state_;
  if (newest) {
    // During homing the newest flags count; afterwards the worst.
    if (state_.homed) newest->homed = homed_in_all;
    take(*newest);
  }
  if (state_.status == ReadStatus::kNothingNew &&
      (reader_.malformed_in_a_row() >= kFalconMostBad || unreachable_in_a_row_ >= kFalconMostBad))
    state_.status = ReadStatus::kGarbled;
  return state_;
}

void FalconDevice::take(const FalconReply& reply) noexcept {
  const bool homed = reply.homed == FalconReply::kAllLegs;
  if (homed && !state_.homed)
    arm_mm_ = kFalconMiddle;  // counters have jumped: the old position is no start value
  homed_legs_ = state_.homing_step = reply.homed;
  state_.homed = homed;
  state_.buttons = reply.buttons;
  if (homed) {
    const Vec3 angles = falcon_angles_of_counts(Vec3{static_cast<double>(reply.counts[0]),
                                                     static_cast<double>(reply.counts[1]),
                                                     static_cast<double>(reply.counts[2])});
    FalconPose pose = falcon_position(angles, arm_mm_);
    if (!pose.converged) pose = falcon_position(angles, kFalconMiddle);
    if (!pose.converged) {
      ++counters_.unreachable;
      ++unreachable_in_a_row_;
      return;  // keeps the last position, not fresh
    }
    arm_mm_ = pose.position_mm;
    state_.position_mm = arm_mm_ - kFalconMiddle;
  }
  unreachable_in_a_row_ = 0;
  state_.packet_ns = clock_.now_ns();
  state_.raw.keep(reader_.bytes());
  state_.status = ReadStatus::kFresh;
}

bool FalconDevice::submit(const FalconBytes& bytes) noexcept {
  const bool taken = link_->submit(bytes);
  if (!taken) ++counters_.refused;
  return taken;
}

// Called every frame, also for zero: motors may hold the last command for ever.
void FalconDevice::send(GovernedForce force) noexcept {
  if (!open_) return;
  FalconCommand command;
  command.flags = flags_of(state_.homed);
  const Vec3& newtons = force.newtons();
  if (state_.homed && newtons != Vec3::Zero()) {
    const std::optional<Vec3> angles = falcon_angles(arm_mm_);
    const std::optional<Mat3> jacobian = angles ? falcon_jacobian(arm_mm_, *angles) : std::nullopt;
    const std::optional<Vec3> torques = jacobian ? falcon_torques(*jacobian, newtons) : std::nullopt;
    if (torques) command.motors = falcon_motors(*torques, options_.counts_per_n_mm);
  }
  submit(encoded(command));
}

// Called by another thread: uses only the link and constants.
bool FalconDevice::cut_force() noexcept {
  return link_->submit(zero_);
}

FalconCounters FalconDevice::counters() const noexcept {
  FalconCounters counters = counters_;
  counters.malformed = reader_.malformed();
  counters.dropped = reader_.dropped();
  return counters;
}

void register_falcon_driver(Drivers& drivers) {
  drivers.add(
      {kDriverName, "usb", look_for_falcons,
       [](const DeviceRequest& asked, const Clock& clock) -> Result<MadeDevice> {
         PALPATE_ASSIGN(FalconRequest request, read_request(asked));
         auto link =
             std::make_unique<UsbLink>(request.address, kFalconInterface, kDriverName, falcon_lets_go);
         MadeDevice made;
         made.unproven = unproven(request.options);
         made.zero = zero_of(request.address);
         made.homing_prompt = falcon_homing_prompt;
         const FalconOptions options = request.options;
         const UsbLink* usb = link.get();
         auto device = std::make_unique<FalconDevice>(std::move(link), clock, options);
         made.facts = [falcon = device.get(), usb, options] { return falcon_facts(*falcon, *usb, options); };
         made.device = std::move(device);
         return made;
       }});
}

}  // namespace palpate::device
