#include "device/haply/planar_driver.h"

#include <fmt/format.h>

#include <string>
#include <utility>
#include <vector>

#include "device/interface/device_facts.h"
#include "device/links/tty_link.h"
#include "toolkit/core/options.h"
#include "toolkit/core/try.h"
#include "toolkit/core/words.h"

namespace palpate::device {
namespace {

constexpr const char* kPlanarWhat = "Haply 2DIY: planar, 2 degrees of freedom; no force along z";

std::string serial_lines_text() {
  std::vector<std::string> paths;
  for (const TtyFound& one : tty_lines()) paths.push_back(one.path);
  return paths.empty() ? "none is connected now" : "there are " + joined(paths);
}

std::vector<DeviceEntry> look_for_planar() {
  return {{"planar",
           kPlanarWhat,
           DeviceStatus::kMissing,
           {"name its serial line, as --device-option path=/dev/serial/by-id/NAME (" + serial_lines_text() +
            ")"}}};
}

struct RequestedPlanar {
  TtyLinkOptions line;
  const PlanarModel* model = planar_model(2);
  PlanarOptions options;
};

Status apply_planar_option(RequestedPlanar& planar, const std::string& key, const std::string& value) {
  if (key == "path") {
    planar.line.path = value;
    return Done{};
  }
  if (key == "generation") {
    planar.model = value == "2" ? planar_model(2) : value == "3" ? planar_model(3) : nullptr;
    if (planar.model == nullptr) return Error{"generation is " + shown(value), "give 2 or 3", "", 0};
    return Done{};
  }
  if (key == "force_n") {
    const Result<double> read = read_number(value, {0.0, planar.options.force_max_n, true});
    if (!read) return Error{key + ": " + read.error().what, read.error().remedy, "", 0};
    planar.options.force_max_n = *read;
    return Done{};
  }
  return Error{"the 2DIY has no option " + shown(key),
               did_you_mean(key, {"path", "generation", "force_n"}, "choose from path, generation, force_n"),
               "", 0};
}

Result<MadeDevice> make_planar(const DeviceRequest& request, const Clock& clock) {
  if (request.name != "planar" || !request.description.empty())
    return Error{"'planar' takes no name and no description file", "give `--device planar`", "", 0};
  RequestedPlanar planar;
  for (const auto& [key, value] : request.options) PALPATE_TRY(apply_planar_option(planar, key, value));
  if (planar.line.path.empty())
    return Error{"the 2DIY's serial line must be named: " + serial_lines_text(),
                 "give --device-option path=/dev/serial/by-id/NAME", "", 0};
  MadeDevice made;
  auto line = std::make_unique<TtyLink>(planar.line);
  made.facts = [model = planar.model, raw = line.get()] {
    const LinkCounters counted = raw->counters();
    return DeviceFacts{{"model", model->name},
                       {"path", raw->path()},
                       {"rest_deg", fmt::format("{:g} {:g}", model->rest_deg[0], model->rest_deg[1])},
                       {"counts_per_turn", fmt::format("{:g}", model->counts_per_turn)},
                       {"link_received", std::to_string(counted.received)},
                       {"link_commands", std::to_string(counted.written)},
                       {"link_commands_overtaken", std::to_string(counted.replaced)}};
  };
  made.device = std::make_unique<PlanarDevice>(std::move(line), clock, *planar.model, planar.options);
  made.zero = [line = planar.line] {
    TtyLink link(line);
    if (!link.open()) return false;
    const bool answered = planar_let_go(link);
    link.close();
    return answered;
  };
  made.unproven = {
      "no 2DIY has been driven by Palpate yet: its set-up, lengths and directions are those that its "
      "maker published",
      "it has 2 degrees of freedom: its grip stays in a plane, and no force acts along z",
      "its board holds the last torque for ever: if all else fails, unplug its power"};
  return made;
}

}  // namespace

void register_planar_driver(Drivers& drivers) {
  drivers.add({"planar", "serial", &look_for_planar, &make_planar});
}

}  // namespace palpate::device
