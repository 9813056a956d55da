// Elements of the page, found and made.

export const at = (id) => document.getElementById(id);

export const made = (tag, attributes = {}, ...children) => {
  const one = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "class") one.className = value; else if (name in one) one[name] = value; else one.setAttribute(name, value);
  }
  one.append(...children);
  return one;
};

export const numberOf = (input) => (input.value === "" ? null : Number(input.value));
