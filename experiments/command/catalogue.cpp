#include "experiments/command/catalogue.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include <palpate/options.h>
#include "toolkit/core/message_text.h"

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

/// With what else the option acts; empty: always.
std::string conditions(const OptionSpec& spec) {
  std::string all;
  for (const OptionCondition& condition : spec.only_with)
    all += (all.empty() ? "" : ", and with ") + text_of(condition);
  return all;
}

/// The bounds that are no mere guard against overflow.
struct Range {
  std::optional<double> low, high;
};

Range range_of(const OptionSpec& spec) {
  // Lengths and speeds may be anything that can be squared and stays a number.
  constexpr double kSmall = 1e-100, kLarge = 1e100;
  Range range;
  if (spec.kind != OptionKind::kNumber && spec.kind != OptionKind::kInteger) return range;
  if (spec.low > -kLarge) range.low = std::abs(spec.low) < kSmall ? 0.0 : spec.low;
  if (spec.high < kLarge) range.high = spec.high;
  return range;
}

std::string range_text(const OptionSpec& spec) {
  const Range range = range_of(spec);
  const char* const least = spec.low > 0.0 && range.low == 0.0 ? "above" : "at least";
  if (range.low && range.high) return fmt::format("{} to {}", *range.low, *range.high);
  if (range.low) return fmt::format("{} {}", least, *range.low);
  if (range.high) return fmt::format("at most {}", *range.high);
  return {};
}

void print_json(std::span<const CatalogueEntry> entries) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const CatalogueEntry& entry : entries) {
    nlohmann::ordered_json options = nlohmann::ordered_json::array();
    for (const OptionSpec& spec : entry.options) {
      nlohmann::ordered_json option = {{"key", spec.key},
                                       {"kind", kind_name(spec.kind)},
                                       {"default", spec.default_value},
                                       {"choices", spec.choices},
                                       {"help", spec.help},
                                       {"only_with", conditions(spec)}};
      const Range range = range_of(spec);
      if (range.low) option["low"] = *range.low;
      if (range.high) option["high"] = *range.high;
      options.push_back(std::move(option));
    }
    nlohmann::ordered_json one = {{"name", entry.name}, {"summary", entry.summary}};
    if (!entry.source.empty()) one["source"] = entry.source;
    if (!entry.role.empty()) {
      one["role"] = entry.role;
      one["works_on"] = entry.works_on;
      one["supports"] = entry.supports;
    }
    if (!entry.models.empty()) one["models"] = entry.models;
    if (!entry.example.empty()) one["example"] = entry.example;
    one["options"] = std::move(options);
    list.push_back(std::move(one));
  }
  fmt::print("{}\n", list.dump(2));
}

}  // namespace

Status keep_named(std::vector<CatalogueEntry>& entries, const std::string& name) {
  if (name.empty()) return Done{};
  std::vector<std::string> names;
  for (const CatalogueEntry& entry : entries) names.push_back(entry.name);
  std::erase_if(entries, [&](const CatalogueEntry& entry) { return entry.name != name; });
  if (!entries.empty()) return Done{};
  return Error{
      "none of them is called " + shown(name), did_you_mean(name, names, "they are " + joined(names)), {}, 0};
}

void print_catalogue(std::span<const CatalogueEntry> entries, bool json) {
  if (json) return print_json(entries);
  for (const CatalogueEntry& entry : entries) {
    fmt::print("{}\n  {}\n", entry.name, entry.summary);
    for (const auto& [about, text] :
         {std::pair{"source", &entry.source}, {"models", &entry.models}, {"example", &entry.example}})
      if (!text->empty()) fmt::print("  {}: {}\n", about, *text);
    if (!entry.role.empty())
      fmt::print("  role: {}, works on {}{}; supports: {}\n", entry.role, entry.works_on,
                 entry.works_on == "formula" ? " (generated models only)" : "",
                 entry.supports.empty() ? "no surface property"
                                        : fmt::format("{}", fmt::join(entry.supports, ", ")));
    for (const OptionSpec& spec : entry.options) {
      std::string values = range_text(spec);
      for (const std::string& c : spec.choices) values += (values.empty() ? "" : "|") + c;
      const std::string only = conditions(spec);
      fmt::print("    {}={}  {}{}{}\n", spec.key, spec.default_value, spec.help,
                 values.empty() ? "" : "  (" + values + ")",
                 only.empty() ? "" : "  (only with " + only + ")");
    }
    fmt::print("\n");
  }
}

}  // namespace palpate::experiments
