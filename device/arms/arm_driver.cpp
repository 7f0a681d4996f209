#include "device/arms/arm_driver.h"

#include <fmt/format.h>

#include <string>
#include <utility>

#include "device/arms/arm_device.h"
#include "device/interface/device_facts.h"
#include "device/links/hid_link.h"
#include "device/links/tty_link.h"
#include "toolkit/core/options.h"
#include "toolkit/core/try.h"
#include "toolkit/core/words.h"

namespace palpate::device {
namespace {

constexpr const char* kArmDriver = "arm";

struct WhereArm {
  std::string text;
  bool there = false, allowed = false;
};

/// Where something answers to the description's ids or name; nothing is opened.
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
  // What answers may be another gadget with the same board.
  entry.what += "; perhaps " + where.text;
  entry.status = where.allowed ? DeviceStatus::kReady : DeviceStatus::kRefused;
  if (!where.allowed)
    entry.needs.emplace_back("install Palpate's udev rules (`palpate devices --doctor` prints them)");
  return entry;
}

std::vector<DeviceEntry> look_for_arms() {
  std::vector<DeviceEntry> all;
  for (const KnownArm& known : known_arms()) all.push_back(arm_entry(known));
  return all;
}

Status apply_arm_option(ArmDescription& arm, const std::string& key, const std::string& value) {
  const auto number = [&](double& into, const NumberRange& range) -> Status {
    const Result<double> read = read_number(value, range);
    if (!read) return Error{key + ": " + read.error().what, read.error().remedy, "", 0};
    into = *read;
    return Done{};
  };
  if (key == "path") {
    (arm.form == ArmForm::kText ? arm.serial_line : arm.hid.path) = value;
    return Done{};
  }
  if (key == "serial" && arm.form != ArmForm::kText) {
    arm.hid.serial = value;
    return Done{};
  }
  // Limits may be lowered here, and raised in the description alone, where they are seen.
  if (key == "current_cap_a") return number(arm.current_cap_a, {0.0, arm.current_cap_a, true});
  if (key == "force_n") return number(arm.limits.force_max_n, {0.0, arm.limits.force_max_n, true});
  if (key == "weight" && (value == "on" || value == "off")) {
    arm.weight = value == "on" && arm.geometry.linkage == ArmLinkage::kChain;
    if (arm.weight || value == "off") return Done{};
    return Error{"only a chain's weight can be held", "leave 'weight' out", "", 0};
  }
  if (key == "weight") return Error{"weight is " + shown(value), "give on or off", "", 0};
  return Error{"an arm has no option " + shown(key),
               did_you_mean(key, {"path", "serial", "current_cap_a", "force_n", "weight"},
                            "choose from path, serial (of reports), current_cap_a, force_n, weight"),
               "", 0};
}

std::string three(const std::array<double, 3>& values) {
  return fmt::format("{:g} {:g} {:g}", values[0], values[1], values[2]);
}

/// What the arm is calibrated with and what came of it.
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
                       {"counts_added", three(device.counts_added())}};
  add_counts(facts, {{"reports", counted.reports},
                     {"reports_malformed", counted.malformed},
                     {"reports_strange", counted.strange},
                     {"counter_jumps", counted.jumps},
                     {"commands_woken", counted.woken},
                     {"commands_at_cap", counted.limited}});
  return facts;
}

/// The arm over a link whose counters its facts tell too.
template <class ArmLink>
void make_over(std::unique_ptr<ArmLink> link, const ArmDescription& arm, const Clock& clock,
               MadeDevice& made) {
  const ArmLink* raw = link.get();
  auto device = std::make_unique<ArmDevice>(arm, std::move(link), clock);
  made.facts = [held = device.get(), raw] {
    DeviceFacts facts = arm_facts(*held);
    const LinkCounters counted = raw->counters();
    facts.emplace_back("path", raw->path());
    facts.emplace_back("link_received", std::to_string(counted.received));
    facts.emplace_back("link_commands", std::to_string(counted.written));
    facts.emplace_back("link_commands_overtaken", std::to_string(counted.replaced));
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
        "give a name, as arm:polhem-v3 (`palpate devices` lists them), or a description file", "", 0};
  Result<ArmDescription> arm =
      name.empty() ? read_arm_description(request.description.string()) : find_arm(name);
  if (!arm) return arm;
  for (const auto& [key, value] : request.options) PALPATE_TRY(apply_arm_option(*arm, key, value));
  return arm;
}

void register_arm_driver(Drivers& drivers) {
  drivers.add({kArmDriver, "hid, serial", &look_for_arms, &make_arm});
}

}  // namespace palpate::device
