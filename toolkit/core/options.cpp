#include <palpate/options.h>

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <system_error>

#include <palpate/result.h>
#include "toolkit/core/messages.h"

namespace palpate {
namespace {

constexpr double kNoBound = 1e300;  // NumberRange's and OptionSpec's value for "no bound"

Status check(const OptionSpec& spec, const std::string& value, std::string_view owner) {
  const auto bad = [&](std::string_view why) {
    return Error{fmt::format("{}: option {}: {}", owner, spec.key, why), spec.help};
  };
  switch (spec.kind) {
    case OptionKind::kText:
      break;
    case OptionKind::kFlag:
      if (value != "true" && value != "false") return bad(shown(value) + " is not true or false");
      break;
    case OptionKind::kChoice:
      if (std::find(spec.choices.begin(), spec.choices.end(), value) == spec.choices.end())
        return bad(fmt::format("{} is not one of {}", shown(value), joined(spec.choices)));
      break;
    case OptionKind::kNumber:
      if (const Result<double> x = read_number(value, {spec.low, spec.high}); !x) return bad(x.error().what);
      break;
    case OptionKind::kInteger:
      if (const Result<long long> x = read_integer(value, {spec.low, spec.high}); !x)
        return bad(x.error().what);
      break;
  }
  return Done{};
}

/// True for equal values of an option; numbers may be written in several ways.
bool same(OptionKind kind, const std::string& a, const std::string& b) {
  if (kind != OptionKind::kNumber && kind != OptionKind::kInteger) return a == b;
  const Result<double> x = parse_number(a), y = parse_number(b);
  return x && y && *x == *y;
}

const OptionSpec* find(std::span<const OptionSpec> specs, std::string_view key) {
  const auto at = std::find_if(specs.begin(), specs.end(), [&](const OptionSpec& s) { return s.key == key; });
  return at == specs.end() ? nullptr : &*at;
}

bool holds(const OptionCondition& condition, const OptionSpec& of, const std::string& value) {
  if (condition.values.empty()) return !same(of.kind, value, of.default_value);
  const bool among = std::any_of(condition.values.begin(), condition.values.end(),
                                 [&](const std::string& v) { return same(of.kind, v, value); });
  return among != condition.except;
}

std::string way_out(const OptionCondition& condition) {
  return fmt::format("leave it out, or {} {}", condition.values.empty() ? "set" : "take", text_of(condition));
}

/// The option's first condition that fails in `complete`, or null.
const OptionCondition* unmet_condition(const OptionSpec& spec, const Options& complete,
                                       std::span<const OptionSpec> specs) {
  for (const OptionCondition& condition : spec.only_with) {
    const OptionSpec* other = find(specs, condition.key);
    assert(other != nullptr);
    if (!holds(condition, *other, complete.text(condition.key))) return &condition;
  }
  return nullptr;
}

/// An Error for a given option without effect beside the others. Its default value is allowed.
Status check_applies(const OptionSpec& spec, const Options& complete, std::span<const OptionSpec> specs,
                     std::string_view owner) {
  const std::string& value = complete.text(spec.key);
  if (same(spec.kind, value, spec.default_value)) return Done{};
  const OptionCondition* condition = unmet_condition(spec, complete, specs);
  if (condition == nullptr) return Done{};
  return Error{fmt::format("{}: option {}={} does nothing with {}={}", owner, spec.key, value, condition->key,
                           complete.text(condition->key)),
               way_out(*condition)};
}

std::string_view without_plus(std::string_view text) {
  return text.size() > 1 && text[0] == '+' && text[1] != '-' ? text.substr(1) : text;
}

/// Reads a whole text as a number; a rest behind the number makes it none.
template <class Number>
std::errc convert(std::string_view text, Number& value) {
  text = without_plus(text);
  const char* const last = text.data() + text.size();
  const auto [end, code] = std::from_chars(text.data(), last, value);
  return end == last ? code : std::errc::invalid_argument;
}

}  // namespace

std::string text_of(const OptionCondition& condition) {
  if (condition.values.empty()) return condition.key;
  std::string all;
  for (const std::string& v : condition.values)
    all += (all.empty() ? "" : " or ") + (condition.except ? v : condition.key + "=" + v);
  return condition.except ? fmt::format("{} other than {}", condition.key, all) : all;
}

std::string text_of(const NumberRange& range) {
  const bool low = range.low > -kNoBound, high = range.high < kNoBound;
  const std::string_view least = range.above_low ? "above" : high ? "from" : "at least";
  if (low && high)
    return fmt::format("{} {} {} {}", least, range.low, range.above_low ? "and up to" : "to", range.high);
  if (low) return fmt::format("{} {}", least, range.low);
  return high ? fmt::format("at most {}", range.high) : std::string();
}

Result<double> read_number(std::string_view text, const NumberRange& range) {
  const auto bad = [&](const std::string& what) {
    const std::string where = text_of(range);
    return Error{fmt::format("{} is not {}", shown(text), what),
                 where.empty() ? std::string("give a number") : "give a number " + where};
  };
  double value = 0;
  const std::errc code = convert(text, value);
  if (code == std::errc::invalid_argument) return bad("a number");
  if (code != std::errc{} || !std::isfinite(value)) return bad("a finite number");
  const bool inside = (range.above_low ? value > range.low : value >= range.low) && value <= range.high;
  if (!inside) return bad("a number " + text_of(range));
  return value;
}

Result<long long> read_integer(std::string_view text, const NumberRange& range) {
  const std::string where = text_of(range);
  const auto bad = [&](const std::string& what) {
    return Error{fmt::format("{} is not {}", shown(text), what), "give a whole number " + where};
  };
  long long value = 0;
  const std::errc code = convert(text, value);
  if (code == std::errc::invalid_argument) return bad("a whole number");
  // Overflow is beyond every bound.
  const auto x = static_cast<double>(value);
  if (code != std::errc{} || x < range.low || x > range.high || (range.above_low && x == range.low))
    return bad(where.empty() ? std::string("a number that fits") : "a whole number " + where);
  return value;
}

Result<double> parse_number(std::string_view text) {
  double value = 0;
  if (convert(text, value) != std::errc{}) return Error{shown(without_plus(text)) + " is not a number"};
  return value;
}

Result<long long> parse_integer(std::string_view text) {
  long long value = 0;
  if (convert(text, value) != std::errc{}) return Error{shown(without_plus(text)) + " is not a whole number"};
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
    return Error{shown(text) + " has no name before its options", "write name:key=value"};
  NamedOptions named{parts.front(), {}};
  for (std::size_t i = 1; i < parts.size(); ++i) {
    const std::size_t equals = parts[i].find('=');
    std::string key = parts[i].substr(0, equals);
    if (key.empty()) return Error{shown(text) + " has an option without a name", "write name:key=value"};
    if (named.options.has(key))
      return Error{fmt::format("{} sets option {} twice", shown(text), shown(key)), "keep one"};
    named.options.set(std::move(key), equals == std::string::npos ? "true" : parts[i].substr(equals + 1));
  }
  return named;
}

Result<Options> validate(const Options& given, std::span<const OptionSpec> specs, std::string_view owner) {
  Options complete;
  for (const OptionSpec& spec : specs) complete.set(spec.key, spec.default_value);
  for (const auto& [key, value] : given.all()) {
    const OptionSpec* spec = find(specs, key);
    if (spec == nullptr) {
      std::vector<std::string> known;
      for (const OptionSpec& s : specs) known.push_back(s.key);
      return Error{fmt::format("{} has no option {}", owner, shown(key)),
                   known.empty() ? "it takes none" : did_you_mean(key, known, "it has " + joined(known))};
    }
    PALPATE_TRY(check(*spec, value, owner));
    complete.set(key, value);
  }
  for (const auto& [key, value] : given.all())
    PALPATE_TRY(check_applies(*find(specs, key), complete, specs, owner));
  return complete;
}

bool option_applies(std::string_view key, const Options& given, std::span<const OptionSpec> specs) {
  const OptionSpec* spec = find(specs, key);
  if (spec == nullptr) return false;
  Options complete;
  for (const OptionSpec& s : specs) complete.set(s.key, s.default_value);
  for (const auto& [name, value] : given.all()) complete.set(name, value);
  return unmet_condition(*spec, complete, specs) == nullptr;
}

}  // namespace palpate
