#include <fmt/format.h>

#include <string>
#include <utility>

#include <palpate/result.h>
#include "device/arms/arm_device.h"
#include "device/interface/driver_options.h"
#include "device/links/hid_link.h"
#include "device/links/tty_link.h"

namespace palpate::device {
namespace {

constexpr const char* kArmDriver = "arm";

struct WhereArm {
  std::string text;
  bool there = false, allowed = false;
};

/// Looks for a device with the description's ids or name, without opening it.
WhereArm where_arm(const ArmDescription& arm) {
  WhereArm where;
  const auto add = [&where](const std::string& text, bool allowed) {
    where.text += (where.there ? ", " : "") + text;
    where.there = true;
    where.allowed = where.allowed || allowed;
  };
  if (arm.form == ArmForm::kText)
    for (const TtyFound& one : tty_lines(arm.serial_line)) add(one.path, one.allowed);
  else
    for (const HidFound& one : hid_devices(arm.hid)) add(one.text(), one.allowed);
  return where;
}

DeviceEntry arm_entry(const KnownArm& known) {
  const Result<ArmDescription> arm = find_arm(known.name);
  DeviceEntry entry{"arm:" + known.name, "open arm", DeviceStatus::kMissing, {}};
  if (!arm) {
    entry.needs.push_back(arm.error().message());
    return entry;
  }
  entry.what = arm->what;
  const WhereArm where = where_arm(*arm);
  if (!where.there) {
    entry.needs.emplace_back("connect it");
    return entry;
  }
  // It may be another gadget with the same board.
  entry.what += "; perhaps " + where.text;
  entry.status = where.allowed ? DeviceStatus::kReady : DeviceStatus::kRefused;
  if (!where.allowed) entry.needs.emplace_back(kUdevRemedy);
  return entry;
}

std::vector<DeviceEntry> look_for_arms() {
  std::vector<DeviceEntry> all;
  for (const KnownArm& known : known_arms()) all.push_back(arm_entry(known));
  return all;
}

/// Options may only lower limits; raising one requires a visible change of the description.
Status take_arm_options(ArmDescription& arm, const DeviceRequest& request) {
  const bool text = arm.form == ArmForm::kText;
  std::vector<DriverOption> options = {text_option("path", text ? arm.serial_line : arm.hid.path)};
  if (!text) options.push_back(text_option("serial", arm.hid.serial));
  options.push_back(number_option("current_cap_a", arm.current_cap_a, {0.0, arm.current_cap_a, true}));
  options.push_back(number_option("force_n", arm.limits.force_max_n, {0.0, arm.limits.force_max_n, true}));
  options.push_back(switch_option("weight", arm.weight));
  PALPATE_TRY(take_options(request, "an arm", options));
  if (arm.weight && arm.geometry.linkage != ArmLinkage::kChain)
    return Error{"only a chain's weight can be held", "leave 'weight' out"};
  return Done{};
}

std::string three(const std::array<double, 3>& values) {
  return fmt::format("{:g} {:g} {:g}", values[0], values[1], values[2]);
}

DeviceFacts arm_facts(const ArmDevice& device) {
  const ArmDescription& arm = device.description();
  const ArmCounters& counted = device.counters();
  constexpr const char* kRests[] = {"start", "button", "power-on"};
  DeviceFacts facts = {{"arm", arm.name},
                       {"capstan_mm", three(arm.capstan_mm)},
                       {"body_mm", three(arm.body_mm)},
                       {"counts_per_turn", three(arm.counts_per_turn)},
                       {"signs", three(arm.sign)},
                       {"torque_n_mm_per_a", three(arm.torque_n_mm_per_a)},
                       {"current_cap_a", fmt::format("{:g}", arm.current_cap_a)},
                       {"rest", kRests[static_cast<std::size_t>(arm.rest)]},
                       {"rest_counts", three(arm.rest_counts)},
                       {"calibration_offset", three(device.calibration_offset())}};
  add_counts(facts, {{"reports", counted.reports},
                     {"reports_malformed", counted.malformed},
                     {"reports_strange", counted.strange},
                     {"counter_jumps", counted.jumps},
                     {"commands_woken", counted.woken},
                     {"commands_at_cap", counted.limited}});
  return facts;
}

/// Makes the arm over a link whose counters become facts.
template <class ArmLink>
void make_over(std::unique_ptr<ArmLink> link, const ArmDescription& arm, const Clock& clock,
               MadeDevice& made) {
  const ArmLink* raw = link.get();
  auto device = std::make_unique<ArmDevice>(arm, std::move(link), clock);
  made.facts = [held = device.get(), raw] {
    DeviceFacts facts = arm_facts(*held);
    facts.emplace_back("path", raw->path());
    add_link_counts(facts, raw->counters());
    return facts;
  };
  made.device = std::move(device);
}

Result<MadeDevice> make_arm(const DeviceRequest& request, const Clock& clock) {
  PALPATE_ASSIGN(const ArmDescription arm, requested_arm(request));
  MadeDevice made;
  if (arm.form == ArmForm::kText)
    make_over(std::make_unique<TtyLink>(TtyLinkOptions{arm.serial_line}), arm, clock, made);
  else
    make_over(std::make_unique<HidLink>(arm.hid), arm, clock, made);
  made.zero = [arm] {
    const std::unique_ptr<Link> link = arm_link(arm);
    if (!link->open()) return false;
    const bool sent = link->submit(encoded_zero(arm.form, arm.report_bytes).span());
    link->close();
    return sent;
  };
  made.homing_prompt = arm_homing_prompt;
  made.unproven = {
      "no arm of this kind has been driven by Palpate yet: lengths, signs and the rest pose are those "
      "that its makers published"};
  if (arm.amplifiers_off_after_s == 0.0)
    made.unproven.emplace_back(
        "whether its motors let go when no command comes: assume that they hold the last force");
  if (!arm.notes.empty()) made.unproven.push_back(arm.notes);
  if (arm.weight) made.unproven.emplace_back("the formula by which the arm's weight is held");
  return made;
}

}  // namespace

std::unique_ptr<Link> arm_link(const ArmDescription& arm) {
  if (arm.form == ArmForm::kText) return std::make_unique<TtyLink>(TtyLinkOptions{arm.serial_line});
  return std::make_unique<HidLink>(arm.hid);
}

Result<ArmDescription> requested_arm(const DeviceRequest& request) {
  const std::size_t colon = request.name.find(':');
  const std::string name = colon == std::string::npos ? "" : request.name.substr(colon + 1);
  if (name.empty() == request.description.empty())
    return Error{
        name.empty() ? "'arm' alone says not which arm" : "an arm is named, and a description given too",
        "give a name, as arm:polhem-v3 (`palpate list devices` lists them), or a description file"};
  Result<ArmDescription> arm =
      name.empty() ? read_arm_description(request.description.string()) : find_arm(name);
  if (!arm) return arm;
  PALPATE_TRY(take_arm_options(*arm, request));
  return arm;
}

void register_arm_driver(Drivers& drivers) {
  drivers.add({kArmDriver, "hid, serial", &look_for_arms, &make_arm});
}

}  // namespace palpate::device
