// Checked reading of integers from JSON. By default, nlohmann::json casts 1e30 or 4294967297 to int without an error.
#pragma once

#include <cstdint>
#include <string>
#include <type_traits>
#include <utility>

namespace tessera {

// A serializer for nlohmann::basic_json on top of `Base`. It throws type_error if an integer is read and the value is
// not an integer or is out of the type's range.
template <template <class, class> class Base>
struct ExactNumbers {
  template <class Value, class Enable = void>
  struct Serializer : Base<Value, Enable> {};

  template <class Value>
  struct Serializer<Value, std::enable_if_t<std::is_integral_v<Value> && !std::is_same_v<Value, bool>>>
      : Base<Value, void> {
    template <class Json>
    static void from_json(const Json& json, Value& value) {
      const bool exact = json.is_number_unsigned()  ? std::in_range<Value>(json.template get_ref<const uint64_t&>())
                         : json.is_number_integer() ? std::in_range<Value>(json.template get_ref<const int64_t&>())
                                                    : false;
      if (!exact) {
        throw Json::type_error::create(
            302, std::string("found ") + json.type_name() + ", expected an integer within range", &json);
      }
      value = json.is_number_unsigned() ? static_cast<Value>(json.template get_ref<const uint64_t&>())
                                        : static_cast<Value>(json.template get_ref<const int64_t&>());
    }
  };
};

}  // namespace tessera
