#include "experiments/command/catalogue.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

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

void print_json(std::span<const CatalogueEntry> entries) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const CatalogueEntry& entry : entries) {
    nlohmann::ordered_json options = nlohmann::ordered_json::array();
    for (const OptionSpec& spec : entry.options)
      options.push_back({{"key", spec.key},
                         {"kind", kind_name(spec.kind)},
                         {"default", spec.default_value},
                         {"choices", spec.choices},
                         {"help", spec.help}});
    nlohmann::ordered_json one = {{"name", entry.name}, {"summary", entry.summary}, {"source", entry.source}};
    if (entry.needs_analytic) one["needs_analytic"] = *entry.needs_analytic;
    one["options"] = std::move(options);
    list.push_back(std::move(one));
  }
  fmt::print("{}\n", list.dump(2));
}

}  // namespace

void print_catalogue(std::span<const CatalogueEntry> entries, bool json) {
  if (json) return print_json(entries);
  for (const CatalogueEntry& entry : entries) {
    fmt::print("{}{}\n  {}\n  source: {}\n", entry.name,
               entry.needs_analytic.value_or(false) ? "  (generated models only)" : "", entry.summary,
               entry.source);
    for (const OptionSpec& spec : entry.options) {
      std::string choices;
      for (const std::string& c : spec.choices) choices += (choices.empty() ? "" : "|") + c;
      fmt::print("    {}={}  {}{}\n", spec.key, spec.default_value, spec.help,
                 choices.empty() ? "" : "  (" + choices + ")");
    }
    fmt::print("\n");
  }
}

}  // namespace palpate::experiments
