#include "device/falcon/falcon_driver.h"

#include <fmt/format.h>

#include <memory>
#include <utility>

#include "device/falcon/falcon_device.h"
#include "device/interface/device_facts.h"
#include "device/links/usb_link.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/options.h"
#include "toolkit/core/try.h"

namespace palpate::device {
namespace {

constexpr const char* kDriverName = "falcon";
constexpr std::uint16_t kFalconVendor = 0x0403, kFalconProduct = 0xCB48;
constexpr UsbInterface kFalconInterface{0, 0x81, 0x02};
constexpr unsigned kZeroWaitMs = 50;
// Away for longer than this it was unplugged, and nothing is left to be done: a device that the dead program
// let go of is back on the bus at once.
constexpr double kAbsentMs = 250.0;
// From what is known of the motors K lies within a factor of ten about the usual one.
constexpr double kLeastCounts = 1.0, kMostCounts = 100.0;

struct FalconRequest {
  FalconOptions options;
  UsbAddress address{kFalconVendor, kFalconProduct, {}};
};

Result<bool> yes_or_no(const std::string& key, const std::string& value) {
  if (value == "yes" || value == "on") return true;
  if (value == "no" || value == "off") return false;
  return Error{key + " is \"" + value + "\"", "give " + key + "=yes or " + key + "=no", kDriverName, 0};
}

Status read_option(const std::string& key, const std::string& value, FalconRequest& request) {
  if (key == "firmware") {
    if (value.empty()) return Error{"firmware names no file", "give firmware=FILE", kDriverName, 0};
    request.options.firmware = [value] { return find_falcon_firmware(falcon_firmware_places(value)); };
  } else if (key == "k") {
    Result<double> number = read_number(value, {kLeastCounts, kMostCounts});
    if (!number) {
      Error error = std::move(number).error();
      error.what = "k: " + error.what;
      return std::move(error).in_file(kDriverName);
    }
    request.options.counts_per_n_mm = *number;
  } else if (key == "calibrated") {
    PALPATE_ASSIGN(request.options.calibrated, yes_or_no(key, value));
  } else if (key == "event-character") {
    PALPATE_ASSIGN(request.options.event_character, yes_or_no(key, value));
  } else {
    return Error{"the Falcon has no option " + key, "it has firmware, k, calibrated and event-character",
                 kDriverName, 0};
  }
  return Done{};
}

Result<FalconRequest> read_request(const DeviceRequest& asked) {
  FalconRequest request;
  if (const auto colon = asked.name.find(':'); colon != std::string::npos) {
    request.address.serial = asked.name.substr(colon + 1);
    if (request.address.serial.empty())
      return Error{"no serial number follows the colon", "give falcon, or falcon:SERIAL", kDriverName, 0};
  }
  if (!asked.description.empty())
    return Error{"the Falcon takes no description file",
                 "leave it out; its options are firmware, k, calibrated and event-character",
                 asked.description.string(), 0};
  bool has_k = false;
  for (const auto& [key, value] : asked.options) {
    PALPATE_TRY(read_option(key, value, request));
    has_k = has_k || key == "k";
  }
  if (request.options.calibrated && !has_k)
    return Error{"calibrated=yes without the number that was found",
                 "give k=COUNTS too: docs/devices.md tells how it is found by weights", kDriverName, 0};
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
        "calibrated by weights (docs/devices.md)");
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
    if (!found.may_open)
      entry.needs.insert(entry.needs.begin(), "this line in /etc/udev/rules.d/70-palpate.rules: " +
                                                  usb_udev_rule(kFalconVendor, kFalconProduct));
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
