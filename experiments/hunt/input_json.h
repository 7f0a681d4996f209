// What is kept of a hunt, as JSON.
#pragma once

#include "experiments/driver/json_document.h"
#include "experiments/hunt/hunt.h"
#include "experiments/hunt/trial.h"

template <>
struct nlohmann::adl_serializer<palpate::Vec3> {
  template <class Json>
  static void to_json(Json& json, const palpate::Vec3& v) {
    json = {v.x(), v.y(), v.z()};
  }
  template <class Json>
  static void from_json(const Json& json, palpate::Vec3& v) {
    v = {json.at(0).template get<double>(), json.at(1).template get<double>(),
         json.at(2).template get<double>()};
  }
};

template <>
struct nlohmann::adl_serializer<palpate::Options> {
  template <class Json>
  static void to_json(Json& json, const palpate::Options& options) {
    json = Json::object();
    for (const auto& [key, value] : options.all()) json[key] = value;
  }
  template <class Json>
  static void from_json(const Json& json, palpate::Options& options) {
    for (const auto& [key, value] : json.items()) options.set(key, value.template get<std::string>());
  }
};

namespace palpate::experiments {

PALPATE_JSON_MEMBERS(PointEdit, kind, which, other, by)
PALPATE_JSON_MEMBERS(Waypoint, kind, at, which, other, frames)
PALPATE_JSON_MEMBERS(HandWay, force_n, fastest_mm_s, spacing_mm, seed)
PALPATE_JSON_MEMBERS(TrialInput, shape, form, points, sampling, noise, outliers, model_seed, scale, offset,
                     friction, edits, way, hand, options)
PALPATE_JSON_MEMBERS(Found, score, trial, frame, trial_input)
PALPATE_JSON_MEMBERS(Fault, what, trial, trial_input)
PALPATE_JSON_MEMBERS(Quest, worst, faults, trials, refused, bound_hits, faulty, spent_s)

}  // namespace palpate::experiments
