#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "experiments/command/commands.h"
#include "experiments/command/session.h"

namespace palpate::experiments {
namespace {

const char* kind_name(OptionKind kind) {
  switch (kind) {
    case OptionKind::kText:
      return "text";
    case OptionKind::kNumber:
      return "number";
    case OptionKind::kInteger:
      return "integer";
    case OptionKind::kFlag:
      return "flag";
    case OptionKind::kChoice:
      return "choice";
  }
  return "text";
}

void print_json(const render::Registry& registry) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const render::RendererInfo& info : registry.all()) {
    nlohmann::ordered_json options = nlohmann::ordered_json::array();
    for (const OptionSpec& spec : info.options)
      options.push_back({{"key", spec.key},
                         {"kind", kind_name(spec.kind)},
                         {"default", spec.default_value},
                         {"choices", spec.choices},
                         {"help", spec.help}});
    list.push_back({{"name", info.name},
                    {"summary", info.summary},
                    {"source", info.source},
                    {"needs_analytic", info.needs_analytic},
                    {"options", options}});
  }
  fmt::print("{}\n", list.dump(2));
}

}  // namespace

int run_renderers(const RenderersArguments& arguments) {
  const render::Registry registry = all_renderers();
  if (arguments.json) {
    print_json(registry);
    return kExitOk;
  }
  for (const render::RendererInfo& info : registry.all()) {
    fmt::print("{}{}\n  {}\n  source: {}\n", info.name,
               info.needs_analytic ? "  (generated models only)" : "", info.summary, info.source);
    for (const OptionSpec& spec : info.options) {
      std::string choices;
      for (const std::string& c : spec.choices) choices += (choices.empty() ? "" : "|") + c;
      fmt::print("    {}={}  {}{}\n", spec.key, spec.default_value, spec.help,
                 choices.empty() ? "" : "  (" + choices + ")");
    }
    fmt::print("\n");
  }
  fmt::print(
      "Options follow the name after colons, as in cloud:shading=none; label=TEXT names one used twice.\n");
  return kExitOk;
}

}  // namespace palpate::experiments
