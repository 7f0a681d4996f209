#include "toolkit/core/options.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

namespace palpate {
namespace {

std::string joined(const std::vector<std::string>& items) {
  std::string text;
  for (const std::string& item : items) text += (text.empty() ? "" : ", ") + item;
  return text;
}

Status check(const OptionSpec& spec, const std::string& value, std::string_view owner) {
  const auto bad = [&](std::string_view wanted) {
    return Error{fmt::format("{}: option {}={} is not {}", owner, spec.key, value, wanted), spec.help, {}, 0};
  };
  switch (spec.kind) {
    case OptionKind::kText:
      return Done{};
    case OptionKind::kFlag:
      if (value == "true" || value == "false") return Done{};
      return bad("true or false");
    case OptionKind::kChoice:
      if (std::find(spec.choices.begin(), spec.choices.end(), value) != spec.choices.end()) return Done{};
      return bad("one of " + joined(spec.choices));
    case OptionKind::kNumber:
    case OptionKind::kInteger: {
      double x = 0;
      if (spec.kind == OptionKind::kNumber) {
        const Result<double> parsed = parse_number(value);
        if (!parsed || !std::isfinite(*parsed)) return bad("a number");
        x = *parsed;
      } else {
        const Result<long long> parsed = parse_integer(value);
        if (!parsed) return bad("a whole number");
        x = static_cast<double>(*parsed);
      }
      if (x < spec.low || x > spec.high) return bad(fmt::format("between {} and {}", spec.low, spec.high));
      return Done{};
    }
  }
  return Done{};
}

}  // namespace

Result<double> parse_number(std::string_view text) {
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  double value = 0;
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (code != std::errc{} || end != text.data() + text.size())
    return Error{fmt::format("'{}' is not a number", text), {}, {}, 0};
  return value;
}

Result<long long> parse_integer(std::string_view text) {
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  long long value = 0;
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (code != std::errc{} || end != text.data() + text.size())
    return Error{fmt::format("'{}' is not a whole number", text), {}, {}, 0};
  return value;
}

const std::string& Options::text(std::string_view key) const {
  const auto found = values_.find(key);
  assert(found != values_.end());
  return found->second;
}

double Options::number(std::string_view key) const {
  return parse_number(text(key)).value();
}
long long Options::integer(std::string_view key) const {
  return parse_integer(text(key)).value();
}
bool Options::flag(std::string_view key) const {
  return text(key) == "true";
}

std::vector<std::string> split_list(std::string_view text, char separator) {
  std::vector<std::string> items;
  while (true) {
    const std::size_t at = text.find(separator);
    items.emplace_back(text.substr(0, at));
    if (at == std::string_view::npos) return items;
    text.remove_prefix(at + 1);
  }
}

Result<NamedOptions> parse_named_options(std::string_view text) {
  const std::vector<std::string> parts = split_list(text, ':');
  if (parts.front().empty())
    return Error{fmt::format("'{}' has no name before its options", text), "write name:key=value", {}, 0};
  NamedOptions named{parts.front(), {}};
  for (std::size_t i = 1; i < parts.size(); ++i) {
    const std::size_t equals = parts[i].find('=');
    std::string key = parts[i].substr(0, equals);
    if (key.empty())
      return Error{fmt::format("'{}' has an option without a name", text), "write name:key=value", {}, 0};
    if (named.options.has(key))
      return Error{fmt::format("'{}' sets option {} twice", text, key), "keep one", {}, 0};
    named.options.set(std::move(key), equals == std::string::npos ? "true" : parts[i].substr(equals + 1));
  }
  return named;
}

Result<Options> validate(const Options& given, std::span<const OptionSpec> specs, std::string_view owner) {
  Options complete;
  for (const OptionSpec& spec : specs) complete.set(spec.key, spec.default_value);
  for (const auto& [key, value] : given.all()) {
    const auto spec = std::find_if(specs.begin(), specs.end(),
                                   [&name = key](const OptionSpec& s) { return s.key == name; });
    if (spec == specs.end()) {
      std::vector<std::string> known;
      for (const OptionSpec& s : specs) known.push_back(s.key);
      return Error{fmt::format("{} has no option '{}'", owner, key),
                   known.empty() ? "it takes none" : "it has " + joined(known),
                   {},
                   0};
    }
    if (const Status status = check(*spec, value, owner); !status) return status.error();
    complete.set(key, value);
  }
  return complete;
}

}  // namespace palpate
