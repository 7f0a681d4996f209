// JSON documents against their schemas under docs/schemas/, by a validator that is not ours.
#pragma once

#include <string>

namespace palpate {

/// What of the document breaks the schema, a line each; empty where nothing does. Stricter than the schema in
/// one thing: a key that it does not name is wrong too, so that documents and schemas stay together.
[[nodiscard]] std::string schema_violations(const std::string& schema_file, const std::string& document);

}  // namespace palpate
