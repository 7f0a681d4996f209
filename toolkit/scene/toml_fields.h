// Reads TOML tables by lists of fields; unknown, wrong or missing keys are Errors with line and column. For
// scene and other TOML readers; the only header that includes toml++.
#pragma once

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <palpate/options.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/core/messages.h"
#include "toolkit/core/tolerances.h"

namespace palpate::scene {

/// Makes Errors with file, line and column of a node.
struct TomlFile {
  const std::string& file;

  [[nodiscard]] Error at(const toml::source_region& source, std::string what, std::string remedy = {}) const {
    return Error{fmt::format("{} (column {})", what, source.begin.column), std::move(remedy), file,
                 static_cast<std::int64_t>(source.begin.line)};
  }
  [[nodiscard]] Error at(const toml::node& node, std::string what, std::string remedy = {}) const {
    return at(node.source(), std::move(what), std::move(remedy));
  }
  /// Resolves a path relative to the file.
  [[nodiscard]] std::string beside(const std::string& name) const;
};

/// One key of a table, its reader and its target.
struct Field {
  using Read = std::function<Status(const toml::node&, const std::string& key, const TomlFile&)>;
  std::string key;
  Read read;  ///< empty: the key belongs to a later version
  bool needed = false;
  std::string example{};             ///< for required fields: an example
  std::vector<std::string> kinds{};  ///< kinds of table that have it; empty: all

  /// Makes the field required.
  [[nodiscard]] Field must(std::string write = {}) &&;
  /// Restricts the field to these kinds.
  [[nodiscard]] Field of(std::vector<std::string> only) &&;
};
using Fields = std::vector<Field>;

/// Reads `table` of a kind (empty: none), called `where` in messages; fields in the order of `fields`.
/// Errors: unknown keys (with the nearest known one), keys of other kinds or later versions, missing required
/// fields.
[[nodiscard]] Status read_fields(const toml::table& table, const Fields& fields, const std::string& where,
                                 const std::string& kind, const TomlFile& in_file);

/// Values of one type.
inline constexpr NumberRange kAnyNumber{};
inline constexpr NumberRange kAboveZero{0.0, 1e300, true};
inline constexpr NumberRange kNotNegative{0.0, 1e300, false};
[[nodiscard]] Result<double> number(const toml::node& node, const std::string& key, const TomlFile& in_file,
                                    const NumberRange& range = kAnyNumber, const std::string& remedy = {});
[[nodiscard]] Result<std::string> text(const toml::node& node, const std::string& key,
                                       const TomlFile& in_file);
/// An option's value as its command-line text.
[[nodiscard]] Result<std::string> option_text(const toml::node& node, const std::string& key,
                                              const TomlFile& in_file);
[[nodiscard]] Result<const toml::table*> table_of(const toml::node& node, const std::string& name,
                                                  const TomlFile& in_file);
/// The tables of a list, written [[name]]; at least one.
[[nodiscard]] Result<std::vector<const toml::table*>> tables_of(const toml::node& node,
                                                                const std::string& name,
                                                                const TomlFile& in_file);
template <std::size_t n>
Result<std::array<double, n>> numbers(const toml::node& node, const std::string& key, const TomlFile& in_file,
                                      const NumberRange& range = kAnyNumber) {
  const toml::array* array = node.as_array();
  if (array == nullptr || array->size() != n)
    return in_file.at(node, fmt::format("'{}' must be a list of {} numbers", key, n));
  std::array<double, n> values{};
  for (std::size_t i = 0; i < n; ++i) {
    PALPATE_ASSIGN(values[i], number(*array->get(i), key, in_file, range));
  }
  return values;
}

/// Reads a value of each type into a target.
template <class T>
Status read_value(const toml::node& node, const std::string& key, T& into, const TomlFile& in_file) {
  if constexpr (std::is_same_v<T, std::string>) {
    PALPATE_ASSIGN(into, text(node, key, in_file));
  } else if constexpr (std::is_same_v<T, bool>) {
    const std::optional<bool> value = node.value_exact<bool>();
    if (!value) return in_file.at(node, fmt::format("'{}' must be true or false", key));
    into = *value;
  } else if constexpr (std::is_integral_v<T>) {
    const std::optional<std::int64_t> value = node.value_exact<std::int64_t>();
    if (!value || *value < 0 || !std::in_range<T>(*value))
      return in_file.at(node, fmt::format("'{}' must be a whole number, 0 or more", key));
    into = static_cast<T>(*value);
  } else if constexpr (std::is_same_v<T, Vec3> || std::is_same_v<T, std::optional<Vec3>>) {
    PALPATE_ASSIGN(const auto v, numbers<3>(node, key, in_file));
    into = Vec3(v[0], v[1], v[2]);
  } else {
    PALPATE_ASSIGN(into, number(node, key, in_file));
  }
  return Done{};
}
template <class T>
Status read_value(const toml::node& node, const std::string& key, std::vector<T>& into,
                  const TomlFile& in_file) {
  const toml::array* array = node.as_array();
  if (array == nullptr) return in_file.at(node, fmt::format("'{}' must be a list", key));
  for (const toml::node& one : *array) PALPATE_TRY(read_value(one, key, into.emplace_back(), in_file));
  return Done{};
}

/// Fields that write to `into`, which must outlive them.
template <class T>
[[nodiscard]] Field field(std::string key, T& into) {
  return {std::move(key), [&into](const toml::node& node, const std::string& name, const TomlFile& in_file) {
            return read_value(node, name, into, in_file);
          }};
}
/// A number in a range, or three of either sign.
template <class T>
[[nodiscard]] Field field(std::string key, T& into, const NumberRange& range, std::string remedy = {}) {
  return {std::move(key),
          [&into, range, remedy = std::move(remedy)](const toml::node& node, const std::string& name,
                                                     const TomlFile& in_file) -> Status {
            if constexpr (std::is_same_v<T, Vec3> || std::is_same_v<T, std::optional<Vec3>>) {
              PALPATE_ASSIGN(const auto v, numbers<3>(node, name, in_file, symmetric(range)));
              into = Vec3(v[0], v[1], v[2]);
            } else {
              PALPATE_ASSIGN(into, number(node, name, in_file, range, remedy));
            }
            return Done{};
          }};
}
/// A value read as a whole by `read`.
template <class T>
[[nodiscard]] Field whole_field(std::string key, T& into,
                                Status (*read)(const toml::node&, T&, const TomlFile&)) {
  return {std::move(key), [&into, read](const toml::node& node, const std::string&, const TomlFile& in_file) {
            return read(node, into, in_file);
          }};
}
/// A choice among `choices` by text.
template <class T>
[[nodiscard]] Field choice(std::string key, T& into, std::vector<std::pair<std::string, T>> choices) {
  return {std::move(key),
          [&into, choices = std::move(choices)](const toml::node& node, const std::string& name,
                                                const TomlFile& in_file) -> Status {
            PALPATE_ASSIGN(const std::string given, text(node, name, in_file));
            std::vector<std::string> known;
            for (const auto& one : choices) {
              if (one.first == given) {
                into = one.second;
                return Done{};
              }
              known.push_back(one.first);
            }
            return in_file.at(node, fmt::format("there is no {} {}", name, shown(given)),
                              did_you_mean(given, known, "choose from " + joined(known)));
          }};
}
/// A path, resolved against the file.
[[nodiscard]] Field file(std::string key, std::string& into);
/// A nested table "[path]"; `name` is its full name if longer.
[[nodiscard]] Field inner(std::string key, Fields fields, std::string kind = {}, std::string name = {});
/// A list of tables "[[model]]": each becomes a T, read by fields_of(T&, kind).
template <class T, class FieldsOf>
[[nodiscard]] Field list(std::string key, std::vector<T>& into, FieldsOf fields_of, std::string kind = {},
                         std::string name = {}) {
  if (name.empty()) name = key;
  return {std::move(key),
          [&into, fields_of = std::move(fields_of), kind = std::move(kind), name = std::move(name)](
              const toml::node& node, const std::string&, const TomlFile& in_file) -> Status {
            PALPATE_ASSIGN(const auto tables, tables_of(node, name, in_file));
            for (const toml::table* table : tables)
              PALPATE_TRY(read_fields(*table, fields_of(into.emplace_back(), kind), "a [[" + name + "]]",
                                      kind, in_file));
            return Done{};
          }};
}

}  // namespace palpate::scene
