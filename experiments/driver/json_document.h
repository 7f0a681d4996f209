// JSON that commands write: documents with schema and provenance, and values that outlast an interruption.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>

#include "toolkit/metrics/result_json.h"

/// A number or text that is missing is null.
template <class T>
struct nlohmann::adl_serializer<std::optional<T>> {
  template <class Json>
  static void to_json(Json& json, const std::optional<T>& value) {
    if (value)
      json = *value;
    else
      json = nullptr;
  }
  template <class Json>
  static void from_json(const Json& json, std::optional<T>& value) {
    value = json.is_null() ? std::nullopt : std::optional<T>(json.template get<T>());
  }
};

namespace palpate::experiments {

using DocumentJson = nlohmann::ordered_json;

/// Schema and provenance (see metrics::DocumentHead); the command's own keys follow.
[[nodiscard]] DocumentJson begin_json(const char* schema, const metrics::DocumentHead& head);
/// Null for an empty text.
[[nodiscard]] DocumentJson text_or_null(const std::string& text);
/// Lines with an indent of one and a last line's end. Bytes that are no UTF-8 are replaced.
[[nodiscard]] std::string document_text(const DocumentJson& json);

/// A value as one line and back. False, and the value as it was, for a line of something else; members that
/// its description leaves out stay.
template <class T>
[[nodiscard]] std::string to_line(const T& value) {
  return nlohmann::json(value).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}
template <class T>
[[nodiscard]] bool from_line(const std::string& line, T& value) {
  try {
    T read = value;
    nlohmann::json::parse(line).get_to(read);
    value = std::move(read);
    return true;
  } catch (const nlohmann::json::exception&) {
    return false;
  }
}

}  // namespace palpate::experiments

/// A struct's members by name, in this order, to and from any kind of JSON: the library's own macro knows
/// sorted objects alone before its version 3.12. Stands in the struct's namespace.
#define PALPATE_JSON_MEMBERS(Type, ...)                                        \
  template <class Json>                                                        \
  void to_json(Json& nlohmann_json_j, const Type& nlohmann_json_t) {           \
    NLOHMANN_JSON_EXPAND(NLOHMANN_JSON_PASTE(NLOHMANN_JSON_TO, __VA_ARGS__))   \
  }                                                                            \
  template <class Json>                                                        \
  void from_json(const Json& nlohmann_json_j, Type& nlohmann_json_t) {         \
    NLOHMANN_JSON_EXPAND(NLOHMANN_JSON_PASTE(NLOHMANN_JSON_FROM, __VA_ARGS__)) \
  }
