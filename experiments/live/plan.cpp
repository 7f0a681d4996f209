// Checks a session's arguments before anything is loaded.
#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/live/hand.h"
#include "experiments/live/session.h"
#include "toolkit/core/message_text.h"

namespace palpate::experiments {
namespace {

Error unknown_word(const char* what, const std::string& word, const std::vector<std::string>& known) {
  return Error{fmt::format("there is no {} '{}'", what, word),
               did_you_mean(word, known, "choose from " + joined(known)),
               {},
               0};
}

Result<device::WorkspaceOptions> workspace_of(const std::string& mapping) {
  constexpr NumberRange kFactors{1e-6, 1e6};
  device::WorkspaceOptions options;
  if (mapping == "1:1") return options;
  if (mapping == "fitted") {
    options.fit = device::WorkspaceFit::kFitted;
    return options;
  }
  const Result<double> factor = read_number(mapping, kFactors);
  if (!factor)
    return Error{fmt::format("--mapping {} is neither 1:1 nor fitted nor a factor: {}", shown(mapping),
                             factor.error().what),
                 "give mm of the scene for a mm of the device, such as 2",
                 {},
                 0};
  options.fit = device::WorkspaceFit::kFactor;
  options.factor = *factor;
  return options;
}

/// Checks that the arguments suit real time and a person's hand.
Status keeps_time(const LiveArguments& arguments, const DeviceChoice& device) {
  if (arguments.accelerated && !arguments.listen.empty())
    return Error{"--listen hears in real time, and --accelerated has none", "leave one of them out", {}, 0};
  if (!device.is_real()) return Done{};
  if (arguments.accelerated)
    return Error{fmt::format("{} runs in real time, not --accelerated", shown(device.name())),
                 "leave --accelerated out",
                 {},
                 0};
  if (arguments.rearm)
    return Error{fmt::format("{} is armed again by a person alone, not by --rearm", shown(device.name())),
                 "leave --rearm out; key r arms again",
                 {},
                 0};
  return Done{};
}

Status check_hand(const LiveArguments& arguments) {
  if (arguments.hand == kMouseHand) {
    if (arguments.link != nullptr) return Done{};
    return Error{"--hand mouse needs a window to move it in", "add --window", {}, 0};
  }
  if (std::find(live_hands().begin(), live_hands().end(), arguments.hand) == live_hands().end())
    return unknown_word("hand", arguments.hand, live_hands());
  return Done{};
}

}  // namespace

Result<LivePlan> plan_live(const LiveArguments& arguments, const std::vector<RendererRequest>& renderers,
                           const render::Registry& registry, const device::Drivers& drivers) {
  const std::vector<std::string> rules = {"wait", "refuse", "free"};
  LivePlan plan;
  PALPATE_ASSIGN(plan.device, choose_device(arguments.device, drivers));
  PALPATE_TRY(keeps_time(arguments, plan.device));
  if (!arguments.listen.empty()) {
    PALPATE_ASSIGN(plan.listen, parse_listen(arguments.listen));
  }
  PALPATE_ASSIGN(plan.workspace, workspace_of(arguments.mapping));
  const auto rule = std::find(rules.begin(), rules.end(), arguments.rule);
  if (rule == rules.end()) return unknown_word("rule", arguments.rule, rules);
  plan.rule = rule == rules.begin()       ? device::SwitchRule::kContactElseWait
              : rule == rules.begin() + 1 ? device::SwitchRule::kContactElseRefuse
                                          : device::SwitchRule::kFreeSpace;
  PALPATE_TRY(check_hand(arguments));
  if (renderers.size() > device::kMaxLanes)
    return Error{fmt::format("--renderers names {} renderers", renderers.size()),
                 fmt::format("one hand takes at most {}", device::kMaxLanes),
                 {},
                 0};
  for (const RendererRequest& request : renderers) plan.settings.push_back({request});
  PALPATE_ASSIGN(plan.changes, parse_changes(arguments.changes, plan.settings, registry));
  return plan;
}

}  // namespace palpate::experiments
