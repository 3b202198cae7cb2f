// Storage for members that most objects leave empty, such as lists of errors.
#pragma once

#include <memory>
#include <utility>

namespace tessera {

// A T that is allocated on the heap on its first edit; until then it equals T() and takes the memory of a pointer.
// Copies are deep. As thread-safe as a T.
template <class T>
class LazyValue {
 public:
  LazyValue() = default;
  LazyValue(T value)  // NOLINT(google-explicit-constructor)
      : value_(value == T() ? nullptr : std::make_unique<T>(std::move(value))) {}
  LazyValue(const LazyValue& other) : value_(other.value_ ? std::make_unique<T>(*other.value_) : nullptr) {}
  LazyValue(LazyValue&&) noexcept = default;
  LazyValue& operator=(const LazyValue& other) { return *this = LazyValue(other); }
  LazyValue& operator=(LazyValue&&) noexcept = default;
  void Clear() { value_.reset(); }

  const T& operator*() const&& = delete;  // the reference would dangle
  const T& operator*() const& {
    static const T kNone;
    return value_ ? *value_ : kNone;
  }
  const T* operator->() const { return &**this; }
  operator const T&() const& { return **this; }  // NOLINT(google-explicit-constructor)
  T& Edit() {
    if (!value_) value_ = std::make_unique<T>();
    return *value_;
  }

 private:
  std::unique_ptr<T> value_;
};

}  // namespace tessera
