// Members of a struct as JSON. Apart from json_document.h, which all documents include.
#pragma once

#include "experiments/driver/json_document.h"

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
