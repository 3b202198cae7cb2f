# Makes a manual page of a help text (CLI11's, with a footer). Variables: name, section, related, version.
function text(s) {  # as roff shows it, no matter what it begins with
  gsub(/\\/, "\\e", s)
  gsub(/-/, "\\-", s)
  return (s ~ /^[.']/ ? "\\&" : "") s
}
function literal(on) {
  if (on != is_literal) print on ? ".nf" : ".fi"
  is_literal = on
}
NR == 1 {
  printf ".TH \"%s\" \"%s\" \"\" \"Tessera %s\"\n.SH NAME\n%s \\- %s\n", toupper(name), section, version, text(name), text($0)
  next
}
/^Usage: / { printf ".SH SYNOPSIS\n%s\n", text(substr($0, 8)); next }
/^\[Option Group: .*\]$/ { literal(0); printf ".SH \"%s\"\n", toupper(substr($0, 16, length($0) - 16)); listing = 1; next }
/^[A-Z][A-Za-z ()]*:$/ {  # a heading of options or commands, or of the footer's examples
  literal(0)
  listing = !/^Examples?:$/
  footer = !listing
  printf ".SH \"%s\"\n", toupper(substr($0, 1, length($0) - 1))
  if (footer) literal(1)
  next
}
listing && /^ +[-a-zA-Z]/ && match($0, /^ +/) && RLENGTH <= 6 {
  entry = substr($0, RLENGTH + 1)
  described = match(entry, /  +/)
  printf ".TP\n\\fB%s\\fR\n", text(described ? substr(entry, 1, RSTART - 1) : entry)
  if (described) print text(substr(entry, RSTART + RLENGTH))
  next
}
listing && /^          / { sub(/^ +/, ""); print text($0); next }
/^$/ { if (listing) { listing = 0; next } if (is_literal) print ""; else pending = 1; next }
{
  if (listing) listing = 0
  if (!footer && !said) { print ".SH DESCRIPTION"; said = 1 }
  else if (pending && !is_literal) print ".PP"
  pending = 0
  if (/^ / && !footer) literal(1)
  else if (!footer) literal(0)
  print text($0)
}
END { literal(0); printf ".SH \"SEE ALSO\"\n%s\n", text(related) }
