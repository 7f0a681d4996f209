#include "device/spacemouse/spacemouse_driver.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "device/interface/device_facts.h"
#include "device/links/hid_link.h"
#include "toolkit/core/options.h"
#include "toolkit/core/try.h"
#include "toolkit/core/words.h"

namespace palpate::device {
namespace {

/// Those connected that are opened, narrowed by path and serial.
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
    if (!one.allowed)
      entry.needs.emplace_back("install Palpate's udev rules (`palpate devices --doctor` prints them)");
    all.push_back(std::move(entry));
  }
  if (all.empty())
    all.push_back({"spacemouse",
                   "3Dconnexion device: moves the HIP, shows the force, has no motors",
                   DeviceStatus::kMissing,
                   {"connect one"}});
  return all;
}

Status apply_spacemouse_option(SpaceMouseOptions& options, HidAddress& address, const std::string& key,
                               const std::string& value) {
  if (key == "path" || key == "serial") {
    (key == "path" ? address.path : address.serial) = value;
    return Done{};
  }
  const std::vector<std::pair<std::string, double*>> numbers = {{"v_max_mm_per_s", &options.v_max_mm_per_s},
                                                                {"dead_zone", &options.dead_zone},
                                                                {"curve", &options.curve},
                                                                {"half_extent_mm", &options.half_extent_mm},
                                                                {"force_max_n", &options.force_max_n}};
  std::vector<std::string> known = {"path", "serial"};
  for (const auto& [name, into] : numbers) {
    known.push_back(name);
    if (name != key) continue;
    const Result<double> read = read_number(value, {});
    if (!read) return Error{key + ": " + read.error().what, read.error().remedy, "", 0};
    *into = *read;
    return Done{};
  }
  return Error{"the spacemouse has no option " + shown(key),
               did_you_mean(key, known, "choose from " + joined(known)), "", 0};
}

Result<MadeDevice> make_spacemouse(const DeviceRequest& request, const Clock& clock) {
  if (request.name != "spacemouse" || !request.description.empty())
    return Error{"'spacemouse' takes no name and no description file", "give `--device spacemouse`", "", 0};
  SpaceMouseOptions options;
  HidAddress address;
  for (const auto& [key, value] : request.options)
    PALPATE_TRY(apply_spacemouse_option(options, address, key, value));
  PALPATE_TRY(check_spacemouse(options));
  const std::vector<HidFound> found = connected_spacemice(address);
  if (found.empty())
    return Error{"there is no 3Dconnexion device", "connect one; `palpate devices` shows what is there", "",
                 0};
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

void register_spacemouse_driver(Drivers& drivers) {
  drivers.add({"spacemouse", "hid", &look_for_spacemice, &make_spacemouse});
}

}  // namespace palpate::device
