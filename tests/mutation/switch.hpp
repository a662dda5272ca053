// Included before a mutated file: each of its mutants sleeps until the environment names its number. So all
// of them are compiled once. `k` of a template: the code is in a constexpr function and must stay constant
// there.
#pragma once

#include <cstdlib>
#include <type_traits>

// Comparisons of comparisons and additions of truths are what a mutant is made of.
#pragma GCC diagnostic ignored "-Wparentheses"
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wsign-compare"
#pragma GCC diagnostic ignored "-Wbool-compare"
#pragma GCC diagnostic ignored "-Wint-in-bool-context"
#pragma GCC diagnostic ignored "-Wextra"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"

namespace mutation {

inline const int active = [] {
    const char* number = std::getenv("WHEELWRIGHT_MUTANT");
    return number == nullptr ? 0 : std::atoi(number);
}();

template <bool k>
constexpr bool on(int number) {
    if constexpr (k) {
        if (std::is_constant_evaluated()) return false;
    }
    return number == active;
}

// `a < less<0>{7} < b` is a < b, and a <= b with mutant 7, and a > b with mutant 8.
#define MUTATION_OPERATOR(NAME, OP, FIRST, SECOND)                                 \
    template <bool k>                                                              \
    struct NAME {                                                                  \
        int number;                                                                \
    };                                                                             \
    template <bool k, typename L>                                                  \
    struct NAME##_left {                                                           \
        L& left;                                                                   \
        int number;                                                                \
    };                                                                             \
    template <bool k, typename L>                                                  \
    constexpr NAME##_left<k, const L> operator OP(const L& left, NAME<k> middle) { \
        return {left, middle.number};                                              \
    }                                                                              \
    template <bool k, typename L, typename R>                                      \
    constexpr auto operator OP(NAME##_left<k, L> l, const R& right) {              \
        return on<k>(l.number)       ? l.left FIRST right                          \
               : on<k>(l.number + 1) ? l.left SECOND right                         \
                                     : l.left OP right;                            \
    }

MUTATION_OPERATOR(less, <, <=, >)
MUTATION_OPERATOR(greater, >, <, >=)
MUTATION_OPERATOR(at_most, <=, <, >=)
MUTATION_OPERATOR(at_least, >=, <=, >)
MUTATION_OPERATOR(equal, ==, !=, ==)
MUTATION_OPERATOR(unequal, !=, ==, !=)
MUTATION_OPERATOR(plus, +, -, +)
MUTATION_OPERATOR(minus, -, +, -)
MUTATION_OPERATOR(times, *, /, *)
MUTATION_OPERATOR(over, /, *, /)
#undef MUTATION_OPERATOR

// `a += (add<0>{7} << b)` is a += b, and a -= b with mutant 7.
template <bool k>
struct add {
    int number;
};
template <bool k>
struct subtract {
    int number;
};
template <bool k, bool adds, typename R>
struct amount {
    const R& right;
    int number;
};
template <bool k, typename R>
constexpr amount<k, true, R> operator<<(add<k> middle, const R& right) {
    return {right, middle.number};
}
template <bool k, typename R>
constexpr amount<k, false, R> operator<<(subtract<k> middle, const R& right) {
    return {right, middle.number};
}
template <bool k, bool adds, typename L, typename R>
constexpr L& operator+=(L& left, amount<k, adds, R> by) {
    return on<k>(by.number) != adds ? left += by.right : left -= by.right;
}
template <bool k, bool adds, typename L, typename R>
constexpr L& operator-=(L& left, amount<k, adds, R> by) {
    return left += by;
}

}  // namespace mutation
