#include "tests/json_schema.h"

#include <fstream>
#include <nlohmann/json.hpp>
#include <valijson/adapters/nlohmann_json_adapter.hpp>
#include <valijson/schema.hpp>
#include <valijson/schema_parser.hpp>
#include <valijson/validator.hpp>

namespace palpate {
namespace {

using nlohmann::json;
using Adapter = valijson::adapters::NlohmannJsonAdapter;

/// Where keys are named and nothing is said about others, others are wrong.
void forbid_other_keys(json& schema) {
  if (schema.is_object() && schema.contains("properties") && schema["properties"].is_object() &&
      !schema.contains("additionalProperties"))
    schema["additionalProperties"] = false;
  if (!schema.is_structured()) return;
  for (json& inner : schema) forbid_other_keys(inner);
}

}  // namespace

std::string schema_violations(const std::string& schema_file, const std::string& document) {
  std::ifstream file(schema_file);
  json rules = json::parse(file, nullptr, false);
  if (rules.is_discarded()) return schema_file + " is not a JSON document\n";
  const json checked = json::parse(document, nullptr, false);
  if (checked.is_discarded()) return "the document is not JSON\n";
  forbid_other_keys(rules);
  valijson::Schema schema;
  valijson::SchemaParser parser;
  try {
    parser.populateSchema(Adapter(rules), schema);
  } catch (const std::exception& error) {
    return schema_file + " is not a schema: " + error.what() + "\n";
  }
  valijson::Validator validator;
  valijson::ValidationResults results;
  if (validator.validate(schema, Adapter(checked), &results)) return {};
  std::string all;
  for (valijson::ValidationResults::Error error; results.popError(error);) {
    for (const std::string& step : error.context) all += step;
    all += ": " + error.description + "\n";
  }
  return all.empty() ? "the document breaks its schema\n" : all;
}

}  // namespace palpate
