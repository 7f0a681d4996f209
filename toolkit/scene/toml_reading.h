// How the parts of a scene file are read: values of the right kind, errors with line and column. Internal to
// scene: the only header that sees toml++.
#pragma once

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "toolkit/core/words.h"
#include "toolkit/scene/scene.h"

namespace palpate::scene {

inline constexpr const char* kLater = "it comes with a later version; remove it";

/// Errors that name the file, and the line and column of a node of it.
struct InFile {
  const std::string& file;

  [[nodiscard]] Error at(const toml::source_region& source, std::string what, std::string remedy = {}) const {
    return Error{fmt::format("{} (column {})", what, source.begin.column), std::move(remedy), file,
                 static_cast<std::int64_t>(source.begin.line)};
  }
  [[nodiscard]] Error at(const toml::node& node, std::string what, std::string remedy = {}) const {
    return at(node.source(), std::move(what), std::move(remedy));
  }
};

inline bool is_among(const std::string& name, const std::vector<std::string>& names) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Refuses keys of `table` that are neither known nor of a later version.
inline Status check_keys(const toml::table& table, const std::vector<std::string>& known,
                         const std::vector<std::string>& later, const std::string& where,
                         const InFile& in_file) {
  for (const auto& [key, node] : table) {
    const std::string name(key.str());
    if (is_among(name, known)) continue;
    if (is_among(name, later))
      return in_file.at(key.source(), fmt::format("'{}' in {} is not in this version", name, where), kLater);
    return in_file.at(key.source(), fmt::format("{} has no key {}", where, shown(name)),
                      did_you_mean(name, known, "it has " + joined(known)));
  }
  return Done{};
}

/// The keys that one kind of a table has beside those that all kinds have.
struct KindKeys {
  std::string kind;  ///< "a texture of kind \"noise\""
  std::vector<std::string> keys;
};

/// The same for a table of `kinds[chosen]`: a key of another kind, which would do nothing, is refused with
/// the kinds that it is of.
inline Status check_keys(const toml::table& table, const std::vector<std::string>& common,
                         const std::vector<KindKeys>& kinds, std::size_t chosen, const InFile& in_file) {
  std::vector<std::string> known = common;
  known.insert(known.end(), kinds[chosen].keys.begin(), kinds[chosen].keys.end());
  for (const auto& [key, node] : table) {
    const std::string name(key.str());
    if (is_among(name, known)) continue;
    std::string others;
    for (const KindKeys& other : kinds)
      if (is_among(name, other.keys)) others += (others.empty() ? "" : ", and of ") + other.kind;
    if (!others.empty())
      return in_file.at(key.source(), fmt::format("'{}' does nothing for {}", name, kinds[chosen].kind),
                        fmt::format("leave it out: it is of {}", others));
  }
  return check_keys(table, known, {}, kinds[chosen].kind, in_file);
}

inline Result<double> number(const toml::node& node, const std::string& key, const InFile& in_file) {
  const std::optional<double> value = node.is_number() ? node.value<double>() : std::nullopt;
  if (!value || !std::isfinite(*value))
    return in_file.at(node, fmt::format("'{}' must be a finite number", key));
  return *value;
}

inline Result<std::string> text(const toml::node& node, const std::string& key, const InFile& in_file) {
  const std::optional<std::string> value = node.value_exact<std::string>();
  if (!value || value->empty()) return in_file.at(node, fmt::format("'{}' must be a text in quotes", key));
  return *value;
}

/// A value of an option, as the text that the command line would have.
inline Result<std::string> option_text(const toml::node& node, const std::string& key,
                                       const InFile& in_file) {
  if (const auto value = node.value_exact<std::string>()) return *value;
  if (const auto value = node.value_exact<bool>()) return std::string(*value ? "true" : "false");
  if (const auto value = node.value_exact<std::int64_t>()) return fmt::format("{}", *value);
  if (const auto value = node.value_exact<double>()) return fmt::format("{}", *value);
  return in_file.at(node, fmt::format("'{}' must be a text, a number, true or false", key));
}

template <std::size_t n>
Result<std::array<double, n>> numbers(const toml::node& node, const std::string& key, const InFile& in_file) {
  const toml::array* array = node.as_array();
  if (array == nullptr || array->size() != n)
    return in_file.at(node, fmt::format("'{}' must be a list of {} numbers", key, n));
  std::array<double, n> values{};
  for (std::size_t i = 0; i < n; ++i) {
    const Result<double> value = number(*array->get(i), key, in_file);
    if (!value) return value.error();
    values[i] = *value;
  }
  return values;
}

inline Result<const toml::table*> table_of(const toml::node& node, const std::string& key,
                                           const InFile& in_file) {
  const toml::table* table = node.as_table();
  if (table == nullptr) return in_file.at(node, fmt::format("'{}' must be a table, written [{}]", key, key));
  return table;
}

/// The tables of a list such as [[model.view]]; none where the key is missing.
inline Result<std::vector<const toml::table*>> tables_of(const toml::table& model_table,
                                                         const std::string& key, const InFile& in_file) {
  std::vector<const toml::table*> tables;
  const toml::node* node = model_table.get(key);
  if (node == nullptr) return tables;
  const toml::array* list = node->as_array();
  if (list == nullptr || list->empty() || !list->is_homogeneous(toml::node_type::table))
    return in_file.at(*node, fmt::format("'{}' must be a list of tables", key),
                      fmt::format("write [[model.{}]] with two brackets", key));
  for (const toml::node& entry : *list) tables.push_back(entry.as_table());
  return tables;
}

/// 'position_mm' and 'rotation' of `table`.
[[nodiscard]] Status read_pose(const toml::table& table, geometry::RigidTransform& pose,
                               const InFile& in_file);

/// [[model.view]] and [[model.clean]]: where points come from beside the model's own file.
[[nodiscard]] Status read_views(const toml::table& model_table, SceneModel& model, const InFile& in_file);
[[nodiscard]] Status read_clean(const toml::table& model_table, SceneModel& model, const InFile& in_file);

/// [model.surface], [[model.region]] and [model.motion].
[[nodiscard]] Status read_surface(const toml::table& model_table, SceneModel& model, const InFile& in_file);
[[nodiscard]] Status read_regions(const toml::table& model_table, SceneModel& model, const InFile& in_file);
[[nodiscard]] Status read_motion(const toml::table& model_table, SceneModel& model, const InFile& in_file);

}  // namespace palpate::scene
