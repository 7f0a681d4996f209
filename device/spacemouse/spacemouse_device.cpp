#include "device/spacemouse/spacemouse_device.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "device/interface/driver_options.h"
#include "device/links/hid_link.h"
#include "toolkit/core/bytes.h"

namespace palpate::device {
namespace {

constexpr std::uint16_t kLogitech = 0x046d, k3Dconnexion = 0x256f;
constexpr std::array kModels = {
    SpaceMouseModel{kLogitech, 0xc603, "SpaceMouse Plus XT", true},
    SpaceMouseModel{kLogitech, 0xc605, "CADman", false},
    SpaceMouseModel{kLogitech, 0xc606, "SpaceMouse Classic", true},
    SpaceMouseModel{kLogitech, 0xc621, "Spaceball 5000", false},
    SpaceMouseModel{kLogitech, 0xc623, "SpaceTraveler", false},
    SpaceMouseModel{kLogitech, 0xc625, "SpacePilot", false},
    SpaceMouseModel{kLogitech, 0xc626, "SpaceNavigator", false},
    SpaceMouseModel{kLogitech, 0xc627, "SpaceExplorer", false},
    SpaceMouseModel{kLogitech, 0xc628, "SpaceNavigator for Notebooks", false},
    SpaceMouseModel{kLogitech, 0xc629, "SpacePilot Pro", false},
    SpaceMouseModel{kLogitech, 0xc62b, "SpaceMouse Pro", false},
    SpaceMouseModel{kLogitech, 0xc640, "NuLOOQ", true},
    SpaceMouseModel{k3Dconnexion, 0xc62e, "SpaceMouse Wireless (cable)", false},
    SpaceMouseModel{k3Dconnexion, 0xc62f, "SpaceMouse Wireless (receiver)", false},
    SpaceMouseModel{k3Dconnexion, 0xc631, "SpaceMouse Pro Wireless (cable)", false},
    SpaceMouseModel{k3Dconnexion, 0xc632, "SpaceMouse Pro Wireless (receiver)", false},
    SpaceMouseModel{k3Dconnexion, 0xc633, "SpaceMouse Enterprise", false},
    SpaceMouseModel{k3Dconnexion, 0xc635, "SpaceMouse Compact", false},
    SpaceMouseModel{k3Dconnexion, 0xc636, "SpaceMouse Module", false},
    SpaceMouseModel{k3Dconnexion, 0xc638, "SpaceMouse Pro Wireless (Bluetooth)", false},
    SpaceMouseModel{k3Dconnexion, 0xc63a, "SpaceMouse Wireless (Bluetooth)", false},
    SpaceMouseModel{k3Dconnexion, 0xc641, "3Dconnexion device without buttons", false},
    SpaceMouseModel{k3Dconnexion, 0xc652, "Universal receiver", false}};

constexpr std::uint8_t kAxesNumber = 1, kTurnsNumber = 2, kButtonsNumber = 3;
constexpr std::size_t kThree = 7, kSix = 13;  // bytes, including the number
constexpr std::size_t kMinButtons = 2, kMaxButtons = 7;

void take_three(std::span<const std::uint8_t> bytes, std::array<std::int16_t, 3>& into) noexcept {
  ByteReader in(bytes);
  for (std::int16_t& axis : into) axis = static_cast<std::int16_t>(in.u16());
}

constexpr double kFullPush = 350.0;  // counts; some exceed it slightly
constexpr std::size_t kPollBytes = 65;
constexpr std::uint32_t kMaxMalformed = 3;
// The slowest model reports every 16 ms while pushed.
constexpr std::int64_t kSilenceNs = 100'000'000;
// Longest frame for integration, so that the HIP does not jump after a pause.
constexpr double kMaxFrameS = 0.02;
constexpr double kRateHz = 1000.0;  // of integration; reports come at 62 to 125 Hz
constexpr double kSteps = 1e-3;     // of full speed over a frame; smaller motion is not intended
constexpr std::array<std::uint8_t, 2> kLampOn = {0x04, 0x01}, kLampOff = {0x04, 0x00};

/// Connected supported models, narrowed by path and serial.
std::vector<HidFound> connected_spacemice(const HidAddress& narrowed) {
  HidAddress address = narrowed;
  address.usage_page = kSpaceMousePage;
  address.usage = kSpaceMouseUsage;
  std::vector<HidFound> found = hid_devices(address);
  std::erase_if(found,
                [](const HidFound& one) { return spacemouse_model(one.vendor, one.product) == nullptr; });
  return found;
}

std::vector<DeviceEntry> look_for_spacemice() {
  std::vector<DeviceEntry> all;
  for (const HidFound& one : connected_spacemice({})) {
    DeviceEntry entry{"spacemouse",
                      std::string(spacemouse_model(one.vendor, one.product)->name) + " at " + one.path +
                          "; moves the HIP, shows the force, has no motors",
                      one.allowed ? DeviceStatus::kReady : DeviceStatus::kRefused,
                      {}};
    if (!one.allowed) entry.needs.emplace_back(kUdevRemedy);
    all.push_back(std::move(entry));
  }
  if (all.empty())
    all.push_back({"spacemouse",
                   "3Dconnexion device: moves the HIP, shows the force, has no motors",
                   DeviceStatus::kMissing,
                   {"connect one"}});
  return all;
}

Result<MadeDevice> make_spacemouse(const DeviceRequest& request, const Clock& clock) {
  if (request.name != "spacemouse" || !request.description.empty())
    return Error{"'spacemouse' takes no name and no description file", "give `--device spacemouse`"};
  SpaceMouseOptions options;
  HidAddress address;
  PALPATE_TRY(take_options(
      request, "the spacemouse",
      {text_option("path", address.path), text_option("serial", address.serial),
       number_option("v_max_mm_per_s", options.v_max_mm_per_s), number_option("dead_zone", options.dead_zone),
       number_option("curve", options.curve), number_option("half_extent_mm", options.half_extent_mm),
       number_option("force_max_n", options.force_max_n)}));
  PALPATE_TRY(check_spacemouse(options));
  const std::vector<HidFound> found = connected_spacemice(address);
  if (found.empty())
    return Error{"there is no 3Dconnexion device", "connect one; `palpate list devices` shows what is there"};
  // Several: the first, since it shows no force, and moving the wrong one is seen at once.
  const HidFound& one = found.front();
  address = {one.vendor, one.product, kSpaceMousePage, kSpaceMouseUsage, "", one.path};
  MadeDevice made;
  auto link = std::make_unique<HidLink>(address, HidLinkOptions{true});
  made.facts = [found_as = one.text(), raw = link.get()] {
    const LinkCounters counted = raw->counters();
    return DeviceFacts{{"found", found_as},
                       {"link_received", std::to_string(counted.received)},
                       {"link_commands", std::to_string(counted.written)}};
  };
  made.device = std::make_unique<SpaceMouseDevice>(std::move(link), clock,
                                                   *spacemouse_model(one.vendor, one.product), options);
  made.has_motors = false;
  made.unproven = {"the direction of its axes, which is the published one for its model"};
  return made;
}

}  // namespace

std::span<const SpaceMouseModel> spacemouse_models() noexcept {
  return kModels;
}

const SpaceMouseModel* spacemouse_model(std::uint16_t vendor, std::uint16_t product) noexcept {
  const auto* at = std::find_if(kModels.begin(), kModels.end(), [&](const SpaceMouseModel& model) {
    return model.vendor == vendor && model.product == product;
  });
  return at == kModels.end() ? nullptr : at;
}

std::optional<SpaceMouseReport> decoded_spacemouse(std::span<const std::uint8_t> bytes) noexcept {
  using Kind = SpaceMouseReport::Kind;
  if (bytes.empty()) return std::nullopt;
  SpaceMouseReport report;
  const std::size_t size = bytes.size();
  switch (bytes[0]) {
    case kAxesNumber:
      if (size != kThree && size != kSix) return std::nullopt;
      report.kind = Kind::kAxes;
      take_three(bytes.subspan(1), report.axes);
      report.has_turns = size == kSix;
      if (report.has_turns) take_three(bytes.subspan(kThree), report.turns);
      return report;
    case kTurnsNumber:
      if (size != kThree) return std::nullopt;
      report.kind = Kind::kTurns;
      report.has_turns = true;
      take_three(bytes.subspan(1), report.turns);
      return report;
    case kButtonsNumber:
      if (size < kMinButtons || size > kMaxButtons) return std::nullopt;
      report.kind = Kind::kButtons;
      for (std::size_t i = 1; i < std::min<std::size_t>(size, 1 + sizeof(report.buttons)); ++i)
        report.buttons |= static_cast<std::uint32_t>(bytes[i]) << (8 * (i - 1));
      return report;
    default:
      return report;
  }
}

Status check_spacemouse(const SpaceMouseOptions& options) {
  const auto wrong = [](const char* name, const char* remedy) {
    return Error{std::string(name) + " is out of range", remedy, "spacemouse"};
  };
  const auto above_zero = [](double value) { return std::isfinite(value) && value > 0.0; };
  if (!above_zero(options.v_max_mm_per_s)) return wrong("v_max_mm_per_s", "give a speed above 0");
  if (!(options.dead_zone >= 0.0 && options.dead_zone < 1.0))
    return wrong("dead_zone", "give a share from 0 to below 1");
  if (!(options.curve >= 1.0 && std::isfinite(options.curve)))
    return wrong("curve", "give an exponent of 1 or above");
  if (!above_zero(options.half_extent_mm)) return wrong("half_extent_mm", "give a length above 0");
  if (!above_zero(options.force_max_n)) return wrong("force_max_n", "give a force above 0");
  return Done{};
}

double spacemouse_speed(double counts, const SpaceMouseOptions& options) noexcept {
  const double push = std::min(1.0, std::abs(counts) / kFullPush);
  if (push <= options.dead_zone) return 0.0;
  const double beyond = (push - options.dead_zone) / (1.0 - options.dead_zone);
  return std::copysign(options.v_max_mm_per_s * std::pow(beyond, options.curve), counts);
}

SpaceMouseDevice::SpaceMouseDevice(std::unique_ptr<Link> link, const Clock& clock,
                                   const SpaceMouseModel& model, const SpaceMouseOptions& options)
    : link_(std::move(link)), clock_(clock), model_(model), options_(options) {}

Status SpaceMouseDevice::open() {
  close();
  PALPATE_TRY(check_spacemouse(options_));
  PALPATE_TRY(link_->open());
  state_ = {};
  velocity_mm_s_.setZero();
  moved_ns_ = heard_ns_ = clock_.now_ns();
  gone_ = silent_ = false;
  malformed_in_a_row_ = 0;
  open_ = true;
  (void)link_->submit(kLampOn);  // some models have none
  return Done{};
}

void SpaceMouseDevice::close() noexcept {
  if (!open_) return;
  open_ = false;
  link_->submit(kLampOff);
  link_->close();
}

DeviceLimits SpaceMouseDevice::limits() const noexcept {
  DeviceLimits limits;
  limits.force_max_n = options_.force_max_n;
  limits.workspace_mm = {Vec3::Constant(-options_.half_extent_mm), Vec3::Constant(options_.half_extent_mm)};
  limits.resolution_mm = kSteps * options_.v_max_mm_per_s / kRateHz;
  limits.rate_hz = kRateHz;
  return limits;
}

void SpaceMouseDevice::take(const SpaceMouseReport& report, std::int64_t now_ns) noexcept {
  using Kind = SpaceMouseReport::Kind;
  heard_ns_ = now_ns;
  silent_ = false;
  if (report.kind == Kind::kButtons) state_.buttons = report.buttons;
  if (report.kind != Kind::kAxes) return;
  const Vec3 counts(report.axes[0], report.axes[1], report.axes[2]);
  const Vec3 turned = model_.axes_as_is ? counts : Vec3(counts.x(), -counts.z(), -counts.y());
  for (int i = 0; i < 3; ++i) velocity_mm_s_[i] = spacemouse_speed(turned[i], options_);
}

DeviceState SpaceMouseDevice::read() noexcept {
  const std::int64_t now_ns = clock_.now_ns();
  std::array<std::uint8_t, kPollBytes> bytes;
  for (int i = 0; open_ && !gone_ && i < kMaxPolls; ++i) {
    const Polled polled = link_->poll(bytes);
    gone_ = polled.gone;
    if (polled.size == 0) break;
    const std::span<const std::uint8_t> came = std::span(bytes).first(polled.size);
    const std::optional<SpaceMouseReport> report = decoded_spacemouse(came);
    malformed_in_a_row_ = report ? 0 : malformed_in_a_row_ + 1;
    if (!report) continue;
    take(*report, now_ns);
    state_.raw.keep(came);
  }
  if (velocity_mm_s_ != Vec3::Zero() && now_ns - heard_ns_ > kSilenceNs) {
    velocity_mm_s_.setZero();
    silent_ = true;
  }
  const double elapsed_s = std::clamp(1e-9 * static_cast<double>(now_ns - moved_ns_), 0.0, kMaxFrameS);
  moved_ns_ = now_ns;
  state_.packet_ns = heard_ns_;
  if (!open_ || gone_ || silent_) {
    state_.status = ReadStatus::kLost;
    return state_;
  }
  if (malformed_in_a_row_ >= kMaxMalformed) {
    velocity_mm_s_.setZero();
    state_.status = ReadStatus::kGarbled;
    return state_;
  }
  const Vec3 most = Vec3::Constant(options_.half_extent_mm);
  state_.position_mm = (state_.position_mm + elapsed_s * velocity_mm_s_).cwiseMax(-most).cwiseMin(most);
  state_.status = ReadStatus::kFresh;
  return state_;
}

void register_spacemouse_driver(Drivers& drivers) {
  drivers.add({"spacemouse", "hid", &look_for_spacemice, &make_spacemouse});
}

}  // namespace palpate::device
