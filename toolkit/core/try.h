// Leaving a function early with the Error of something it called.
#pragma once

#include <utility>

#include "toolkit/core/result.h"

/// Calls what gives a Status (or a Result whose value is not wanted) and returns its Error where it failed:
/// PALPATE_TRY(check_size(columns, rows));
#define PALPATE_TRY(...)                                                                                  \
  do {                                                                                                    \
    if (auto palpate_tried = (__VA_ARGS__); !palpate_tried.ok()) return std::move(palpate_tried).error(); \
  } while (false)

/// Declares a variable with the value of a Result, or returns its Error:
/// PALPATE_ASSIGN(const double scale, number(node, "scale"));
/// Two statements: not for the branch of an `if` without braces. A declaration with a comma needs `auto`.
#define PALPATE_ASSIGN(declaration, ...) \
  PALPATE_ASSIGN_AS(PALPATE_NAME_HERE(palpate_result_, __LINE__), declaration, __VA_ARGS__)
#define PALPATE_ASSIGN_AS(result, declaration, ...)     \
  auto result = (__VA_ARGS__);                          \
  if (!(result).ok()) return std::move(result).error(); \
  declaration = *std::move(result) /* NOLINT(bugprone-macro-parentheses): a declaration */
#define PALPATE_NAME_HERE(name, line) PALPATE_NAME_HERE_TOO(name, line)
#define PALPATE_NAME_HERE_TOO(name, line) name##line
